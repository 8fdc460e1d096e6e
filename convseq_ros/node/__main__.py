# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The process of `vpr_node`, also `python -m convseq_ros.node`."""

import sys

from convseq_ros.process import run


def main() -> int:
    """Run the node; a signal ends it cleanly, also while it starts."""
    return run('convseq_ros.node.vpr_node', 0)


if __name__ == '__main__':
    sys.exit(main())
