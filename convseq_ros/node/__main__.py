# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The process of `vpr_node`, also `python -m convseq_ros.node`."""

from typing import NoReturn

from convseq_ros.process import run_node


def main() -> NoReturn:
    """Run the node; a signal ends it cleanly, also while it starts."""
    run_node('convseq_ros.node.vpr_node')


if __name__ == '__main__':
    main()
