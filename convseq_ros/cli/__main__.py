# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The process of `convseq`, also `python -m convseq_ros.cli`."""

import signal
import sys

from convseq_ros.cli import main as run
from convseq_ros.cli import SIGNALS
from convseq_ros.cli.streams import finish, prepare


def main() -> int:
    """Run a sub-command; if SIGINT or SIGTERM ends it, print one line."""
    prepare()
    for number in SIGNALS:
        signal.signal(number, signal.default_int_handler)  # which raises KeyboardInterrupt
    try:
        code = run()
    except SystemExit as ended:  # of argparse
        code = ended.code if isinstance(ended.code, int) else 0
    return finish(code)


if __name__ == '__main__':
    sys.exit(main())
