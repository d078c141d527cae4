"""`python -m drake_pregrasp` is the command `drake-pregrasp`."""

import sys

from drake_pregrasp.cli import main

sys.exit(main())
