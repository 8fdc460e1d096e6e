# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the process of a node uses memory."""

import subprocess
import sys

SCRIPT = """
import resource
from convseq_ros.node.running import keep_memory_at_hand
keep_memory_at_hand()
for number in range(40):
    if number == 10:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    images = [bytearray(b'x') * 921_600 for _ in range(3)]
    del images
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def test_the_memory_of_an_image_serves_the_next():
    """Three copies of an image of 640 x 480 are 675 pages, 30 times."""
    done = subprocess.run([sys.executable, '-c', SCRIPT], capture_output=True, check=True)
    assert int(done.stdout) < 675
