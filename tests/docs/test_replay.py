"""The example that plays a recording to a tap: the tap sees what is in the recording."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import modlens
from tests.conftest import CAPTURES, ROOT
from tests.support.gateway_programs import free_port

RECORDING = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"


def test_a_tap_sees_what_was_recorded(tmp_path: Path) -> None:
    port = str(free_port())
    script = tmp_path / "replay.py"
    text = (ROOT / "docs" / "examples" / "replay.py").read_text("utf-8")
    script.write_text(text.replace("5020", port), encoding="utf-8")
    rows = tmp_path / "rows.jsonl"
    tap = [sys.executable, "-m", "analyzer", "tap", f"socket://localhost:{port}"]
    with subprocess.Popen(
        [sys.executable, script, RECORDING], cwd=ROOT, stdout=subprocess.PIPE, text=True
    ) as player:
        assert player.stdout is not None
        assert player.stdout.readline().startswith("now: modlens tap")
        done = [*tap, "--duration", "8s", "-o", str(rows)]
        subprocess.run(done, cwd=ROOT, check=True, capture_output=True, timeout=60)
    found = [json.loads(line)["request_hex"] for line in rows.read_text("utf-8").splitlines()]
    wanted = [row.request_hex for row in modlens.decode(RECORDING).transactions]
    assert found == [one.hex() if one else None for one in wanted]
