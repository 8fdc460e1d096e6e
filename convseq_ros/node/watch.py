# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shows a node's answers in a terminal: the last image beside its place, and counts."""

import argparse
from collections import Counter, deque
from pathlib import Path
import sys
import time
from typing import Any

from convseq_ros.node.process import check_logs, end_on_signal, run_node

if __name__ == '__main__':
    # Before NumPy, OpenCV and rclpy are imported, which takes a second.
    run_node('convseq_ros.node.watch')

from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.map.image_coding import decode_jpeg
from convseq_ros.core.map.reader import open_map
from convseq_ros.core.map.reference_map import ReferenceMap
from convseq_ros.errors import ConvseqError, ImageError, MapError
from convseq_ros.node.cameras import ImageSubscription
from convseq_ros.node.listener import ListeningNode
from convseq_ros.node.running import spin
from convseq_ros.node.topics import FollowingSubscription
from convseq_ros.sources.images import gray_and_color, message_pixels
from convseq_ros.sources.raw_message import RawMessage
import cv2
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import numpy.typing as npt
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args, try_shutdown
from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

_PICTURE_COLUMNS = 38  # of a terminal; a character shows two pixels, one above the other
_SHOWN_EVERY_S = 0.2
_RATE_FRAMES = 20
_COLOURS = {'accepted': 'green', 'rejected': 'yellow', 'skipped': 'bright_black'}


class Watcher(ListeningNode):
    """Listens to a node's `answer`, and to its camera if a topic is given in `options`."""

    def __init__(self, options: argparse.Namespace) -> None:
        super().__init__('convseq_watch')
        self._map_path = options.map
        self._map = open_map(options.map) if options.map else None
        self._reasons: Counter[str] = Counter()
        self._times: deque[float] = deque(maxlen=_RATE_FRAMES)
        self._answer: dict[str, str] = {}
        self._problem = ''  # why the place is not shown
        self._place: npt.NDArray[np.uint8] | None = None
        self._camera: npt.NDArray[np.uint8] | None = None
        topic = f'{options.node}/answer'
        FollowingSubscription(self, DiagnosticArray, topic, self._on_answer, _RATE_FRAMES)
        if options.topic:
            ImageSubscription(self, 1, self._on_image, options.topic).start()
        self._waiting = f'waiting for {topic}'

    def _on_answer(self, message: Any) -> None:
        self._answer = {pair.key: pair.value for pair in message.status[0].values}
        self._reasons[self._answer['reason']] += 1
        self._times.append(time.monotonic())
        if self._map and (best := self._answer['best_index']):
            try:
                self._place, self._problem = self._picture(self._map, int(best)), ''
            except MapError as error:
                self._place, self._problem = None, str(error)

    def _picture(self, places: ReferenceMap, index: int) -> npt.NDArray[np.uint8] | None:
        if index >= len(places):
            self._map = places = open_map(self._map_path)  # it has grown
        return decode_jpeg(places.thumbnail(index)) if index < len(places) else self._place

    def _on_image(self, message: RawMessage, _topic: str) -> None:
        try:
            self._camera = gray_and_color(message_pixels(message), ReadingConfig())[0]
        except ImageError:
            self._camera = None

    def view(self) -> RenderableType:
        if not self._answer:
            return Text(self._waiting)
        answer, colour = self._answer, _COLOURS[self._answer['status']]
        table = Table.grid(padding=(0, 1))
        place = answer['reference_index'] or answer['best_index'] or '-'
        table.add_row('frame', answer['query_index'], Text(answer['reason'], colour))
        table.add_row('place', place, f'k {answer["sequence_length"]}')
        for name in ('best_score', 'confidence'):
            value = float(answer[name] or 0.0)
            bar = ProgressBar(1.0, value, width=30, complete_style=colour)
            table.add_row(name, f'{value:.3f}', bar)
        table.add_row('rate', f'{self._rate():.1f} Hz', f'{float(answer["duration_ms"]):.0f} ms')
        pictures = [drawn(gray) for gray in (self._camera, self._place) if gray is not None]
        counts = ', '.join(f'{reason} {count}' for reason, count in self._reasons.most_common())
        below = Text(counts, 'bright_black'), Text(self._problem, 'yellow')
        return Group(Columns(pictures, padding=(0, 2)), table, *below)

    def _rate(self) -> float:
        spent_s = self._times[-1] - self._times[0]
        return (len(self._times) - 1) / spent_s if spent_s > 0 else 0.0


def drawn(gray: npt.NDArray[np.uint8]) -> Text:
    """Return a picture (H, W) in characters whose upper and lower halves are pixels."""
    height = round(gray.shape[0] / gray.shape[1] * _PICTURE_COLUMNS / 2) * 2
    small = cv2.resize(gray, (_PICTURE_COLUMNS, max(2, height)), interpolation=cv2.INTER_AREA)
    picture = Text()
    for upper, lower in zip(small[::2].tolist(), small[1::2].tolist(), strict=True):
        for above, below in zip(upper, lower, strict=True):
            picture.append(
                '\u2580', f'rgb({above},{above},{above}) on rgb({below},{below},{below})'
            )
        picture.append('\n')
    return picture


def parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(
        prog='convseq watch', description='See in a terminal what a running node recognises.'
    )
    result.add_argument('map', type=Path, nargs='?', help='the map, to show its places')
    result.add_argument('--topic', default='', help='camera topic, to show what it sees')
    result.add_argument(
        '--node', default='/vpr_node', metavar='NAME', help='the node (default: %(default)s)'
    )
    return result


def main(args: list[str] | None = None) -> int:
    """Watch until SIGINT or SIGTERM; return the exit code."""
    argv = sys.argv if args is None else ['convseq watch', *args]
    options = parser().parse_args(remove_ros_args(argv)[1:])
    end_on_signal(0)
    check_logs()
    try:
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
        watcher = Watcher(options)
    except ConvseqError as error:
        print(f'convseq watch: {error}', file=sys.stderr)
        return 1
    shown_s = 0.0
    try:
        with Live(watcher.view(), console=Console(), auto_refresh=False) as live:
            for _ in spin(watcher):
                if time.monotonic() - shown_s >= _SHOWN_EVERY_S:
                    live.update(watcher.view(), refresh=True)
                    shown_s = time.monotonic()
            live.update(watcher.view())
    finally:
        try_shutdown()
    return 0
