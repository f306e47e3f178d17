"""``python -m railinspect`` is the ``railinspect`` command."""

import sys

from railinspect.cli import main

sys.exit(main())
