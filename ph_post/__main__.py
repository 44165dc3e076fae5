"""``python -m ph_post``: the same as the console script."""

import sys

from ph_post.cli.main import console_main

sys.exit(console_main())
