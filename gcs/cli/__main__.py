"""`python -m gcs.cli`: the same as `tippath`."""

from __future__ import annotations

import sys

from gcs.cli import main

sys.exit(main())
