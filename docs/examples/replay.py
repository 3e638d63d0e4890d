"""Plays a recording to `modlens tap socket://localhost:5020`, as a line would: a rehearsal.

python docs/examples/replay.py captures/pymodbus_disturbed/recording.jsonl [SPEED]
"""

import socket
import sys
import time

import modlens

RECORDING, SPEED = sys.argv[1], float(sys.argv[2] if sys.argv[2:] else 1)

with socket.create_server(("localhost", 5020)) as server:
    sys.stdout.write("now: modlens tap socket://localhost:5020\n")
    sys.stdout.flush()
    tap, _ = server.accept()
    begun = time.monotonic()
    for frame in modlens.decode(RECORDING).frames:
        time.sleep(max((frame.elapsed_us or 0) / 1e6 / SPEED - (time.monotonic() - begun), 0))
        try:
            tap.sendall(frame.hex)
        except ConnectionError:
            sys.exit("the tap has ended")
    time.sleep(1)  # The last answer is complete when the line has been silent.
