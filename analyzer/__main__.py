"""`python -m analyzer` is `modlens`."""

import sys

from analyzer.cli import main

sys.exit(main())
