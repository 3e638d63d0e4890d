"""Tests over a folder of vectors that is not part of the project: `make vectors CORPUS=folder`."""

import os

collect_ignore = [] if "CORPUS" in os.environ else ["test_vectors.py"]
