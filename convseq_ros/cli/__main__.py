# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The process of `convseq`, also `python -m convseq_ros.cli`."""

import sys

from convseq_ros.cli.streams import finish, prepare
from convseq_ros.node.process import run


def main() -> int:
    """Run a sub-command; if a signal ends it, print one line."""
    prepare()
    try:
        code = run('convseq_ros.cli', 1, 'convseq: interrupted\n')
    except SystemExit as ended:  # of argparse
        code = ended.code if isinstance(ended.code, int) else 0
    return finish(code)


if __name__ == '__main__':
    sys.exit(main())
