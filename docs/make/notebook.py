"""The notebook of the site: docs/notebook.md in jupytext's Markdown, executed when it is built.

`notebook_page()` gives the files that come of it: the page with the outputs after the cells, their
pictures, and the notebook itself to download. A cell that raises stops the build.
"""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from docs.make import day

__all__ = ["executed", "notebook_page"]

SOURCE = Path(__file__).parents[1] / "notebook.md"
PICTURES = "pictures/notebook"
TIMEOUT_S = 120


def executed() -> Any:
    """The notebook with its outputs, executed in a folder that has the day's recording."""
    import jupytext  # noqa: PLC0415 - the tools of the site are not installed everywhere
    from nbclient import NotebookClient  # noqa: PLC0415 - as above

    notebook = jupytext.read(SOURCE)
    with tempfile.TemporaryDirectory() as folder:
        day.write(Path(folder) / "day.jsonl")
        resources = {"metadata": {"path": folder}}
        client = NotebookClient(notebook, timeout=TIMEOUT_S, resources=resources)
        client.extra_arguments = ["--log-level=40"]  # no word on how the kernel is reached
        client.execute()
    return notebook


def notebook_page() -> dict[str, str | bytes]:
    """Path in the site -> content: the page, its pictures, the notebook."""
    import jupytext  # noqa: PLC0415 - as above

    notebook = executed()
    files: dict[str, str | bytes] = {"day.ipynb": jupytext.writes(notebook, fmt="ipynb")}
    parts: list[str] = []
    for number, cell in enumerate(notebook.cells):
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            parts += _shown(output, f"{PICTURES}-{number}.png", files)
    files["notebook.md"] = "\n\n".join(parts) + "\n"
    return files


def _shown(output: Any, name: str, files: dict[str, str | bytes]) -> Iterator[str]:
    """An output in Markdown; a picture becomes a file."""
    if output.output_type == "stream":
        yield f"```text\n{output.text.rstrip()}\n```"
        return
    data: Mapping[str, str] = output.get("data", {})
    if "image/png" in data:
        files[name] = base64.b64decode(data["image/png"])
        yield f"![plot]({name})"
    elif "text/html" in data:
        yield f'<div class="output">\n{data["text/html"]}\n</div>'
    elif "text/plain" in data:
        yield f"```text\n{data['text/plain'].rstrip()}\n```"
