# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Draw what `convseq watch` shows in the middle of a drive; needs the extras ros and watch.

Usage: watch_svg.py DRIVE MAP FILE, after the tutorial "A first map": demo/second street.db.
"""

from pathlib import Path
import sys

from convseq_ros.core.map.reader import open_map
from convseq_ros.core.recognizer import PlaceRecognizer
from convseq_ros.node.conversions import answer_message
from convseq_ros.node.watch import parser, Watcher
from convseq_ros.sources import open_source
import rclpy
from rich.console import Console

drive, map_path, file = sys.argv[1:]
rclpy.init()
watcher = Watcher(parser().parse_args([map_path]))
recognizer = PlaceRecognizer(open_map(map_path))
source = open_source(Path(drive))
for number, frame in enumerate(source):
    watcher._camera = frame.gray
    match = recognizer.process(frame)
    watcher._on_answer(answer_message(match, 25.0, recognizer.reference_map, 'map'))
    if number == len(source) // 2:
        break
console = Console(record=True, width=84, file=open('/dev/null', 'w'))
console.print(watcher.view())
console.save_svg(file, title='convseq watch')
rclpy.shutdown()
