# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drive a drawn town for hours with the real node: `python -m bench.soak`, from the repository.

Memory, handles and threads of the node, and the times to its answers, are written as a table, a
picture and a line. The exit code is 1 if frames are unaccounted for, or if memory grows by more
than 1 % per hour in addition to the places.

    python -m bench.soak --mode preloaded --rate 10 --minutes 100
    python -m bench.soak --mode online --frames 288000      as fast as the node can process
    python -m bench.soak --mode online --frames 30000 --mosaics     each image a place

Each sample is written at once, so that an interrupted drive keeps its samples.
"""

import argparse
from collections.abc import Iterator, Sequence
import csv
from functools import partial
from itertools import count, cycle, product
from pathlib import Path
import sys
import tempfile
import time
from typing import Any, NamedTuple

from convseq_ros.app.map_builder import build_map
from convseq_ros.config import make_config
from convseq_ros.core.types import Frame
from convseq_ros.evaluation.plots import new_figure, save
from convseq_ros.simulation.drive import draw, Drive
from convseq_ros.simulation.route import Route
import numpy as np
import numpy.typing as npt

from bench.robot import image, Robot, robot, unaccounted

_TOWN = Route(((0, 0), (100, 0), (100, 80), (0, 80), (0, 0)), seed=5)
_PERIOD_NS = 100_000_000  # between two frames of the drive, at any rate: a camera of 10 Hz
_IN_FLIGHT = 4  # unanswered frames, without a rate
_SAMPLE_S = 5.0
_WARM_SHARE = 0.2  # of the samples, before memory growth counts
_MOST_GROWTH = 1.0  # percent per hour
_EACH_PLACES = 2000
_STEADY = 0.98  # correlation of places and time
_PATIENCE_S = 30.0
_GRAIN = 3.0  # standard deviation of the noise, which differs from lap to lap, gray levels
_SPARE_PX = 512  # by which the noise field is wider and higher than an image
_TILES = 4  # of a mosaic, in a row and in a column
_STRETCH = 50  # mosaics


class Sample(NamedTuple):
    """The state of the node at one moment."""

    seconds: float
    frames: int
    places: int
    resident_mb: float
    handles: int
    threads: int
    median_ms: float  # from image to answer, since the previous sample
    worst_ms: float
    dropped: int = 0
    lost: int = 0
    failed: int = 0
    unaccounted: int = 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive, write the samples, and return the exit code."""
    chosen = _parser().parse_args(arguments)
    print(f'soak: drawing {chosen.lap} frames of a town', file=sys.stderr, flush=True)
    lap = _lap(chosen.lap, chosen.width_px)
    stem = f'soak_{chosen.mode}_{f"{chosen.rate:g}_hz" if chosen.rate else "fast"}'
    stem += '_mosaics' * chosen.mosaics
    chosen.output.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory(prefix='convseq_soak_') as folder,
        (chosen.output / f'{stem}.csv').open('w', newline='', encoding='utf-8') as file,
    ):
        table = csv.writer(file, lineterminator='\n')
        table.writerow(Sample._fields)
        samples = []
        for sample in _soak(chosen, lap, Path(folder)):
            samples.append(sample)
            table.writerow(sample)
            file.flush()
    for line in _by_places(samples):
        print(line)
    last, (percent_an_hour, kb_a_place) = samples[-1], growth(samples)
    text = (
        f'{chosen.mode}, {last.frames:,} frames in {last.seconds / 60:.0f} min: {last.places:,} '
        f'places, {last.resident_mb:.0f} MB, {percent_an_hour:+.2f} % an hour and '
        f'{kb_a_place:.2f} kB a place; {last.dropped} dropped, {last.lost} lost, {last.failed} '
        f'failed, {last.unaccounted} unaccounted for'
    )
    _picture(samples, text, chosen.output / f'{stem}.png')
    print(text)
    return int(last.unaccounted != 0 or last.failed > 0 or percent_an_hour > _MOST_GROWTH)


def growth(samples: Sequence[Sample]) -> tuple[float, float]:
    """
    Return the growth of memory after the warm-up, in percent per hour and in kB per place.

    The first is 0 if places are added at such a steady rate that time and places cannot be
    separated. The second is 0 without new places.
    """
    rows = samples[int(len(samples) * _WARM_SHARE) :]
    if len(rows) < 3:
        return 0.0, 0.0
    hours = np.array([sample.seconds for sample in rows]) / 3600
    places = np.array([sample.places for sample in rows], float)
    memory = np.array([sample.resident_mb for sample in rows])
    columns = [np.ones(len(rows)), hours - hours[0], places - places[0]]
    if not np.ptp(places):
        columns[2] *= 0
    elif np.corrcoef(hours, places)[0, 1] > _STEADY:
        columns[1] *= 0
    (start, slope, of_places), *_ = np.linalg.lstsq(np.stack(columns, 1), memory, rcond=None)
    return float(100 * slope / start), float(1e3 * of_places)


def _by_places(samples: Sequence[Sample]) -> Iterator[str]:
    """Yield lines that say how memory grew with each so many places."""
    before = samples[0]
    for sample in samples:
        if (more := sample.places - before.places) >= _EACH_PLACES:
            kb = 1e3 * (sample.resident_mb - before.resident_mb) / more
            yield f'{sample.places:,} places: {sample.resident_mb:.1f} MB, {kb:.2f} kB a place'
            before = sample


def _grain(height: int, width: int) -> Iterator[npt.NDArray[np.int16]]:
    """Yield the noise of a camera: random parts of a field, so that it hardly repeats."""
    random = np.random.default_rng(0)
    field = random.normal(0, _GRAIN, (height + _SPARE_PX, width + _SPARE_PX)).astype(np.int16)
    while True:
        row, column = random.integers(0, _SPARE_PX, 2)
        yield field[row : row + height, column : column + width]


def _lap(count: int, width_px: int) -> list[npt.NDArray[np.uint8]]:
    speed = (_TOWN.length_m - 1) / count * 10
    drive = Drive(
        num_frames=count, speed_mps=speed, frame_rate_hz=10, width_px=width_px,
        height_px=width_px * 3 // 4,
    )  # fmt: skip
    return [np.asarray(shot.frame.gray) for shot in draw(_TOWN, drive)]


def _mosaics(lap: list[npt.NDArray[np.uint8]]) -> Iterator[npt.NDArray[np.uint8]]:
    """Yield places without end, of tiles of a lap; of each five stretches one is shown again."""
    height, width = (size // _TILES for size in lap[0].shape)
    for number in count():
        is_again = number // _STRETCH % 5 == 4
        random = np.random.default_rng(number - 4 * _STRETCH * is_again)
        made = lap[0].copy()
        for row, column in product(range(_TILES), repeat=2):
            part = np.s_[row * height : (row + 1) * height, column * width : (column + 1) * width]
            made[part] = lap[random.integers(len(lap))][part]
        yield made


def _soak(
    chosen: argparse.Namespace, lap: list[npt.NDArray[np.uint8]], folder: Path
) -> Iterator[Sample]:
    """Drive, and yield samples of the node at intervals and at the end."""
    path, overlap, size_px = folder / 'map.db', chosen.keyframe_overlap, chosen.image_size_px
    if chosen.mode == 'preloaded':
        frames = [Frame((index + 1) * _PERIOD_NS, gray) for index, gray in enumerate(lap)]
        config = make_config({'keyframe_overlap': overlap, 'image_size_px': size_px})
        build_map(frames, path, config)
    grain = _grain(*lap[0].shape)
    with robot(
        folder,
        mode=chosen.mode,
        map_path=path,
        queue_size=100,
        max_wait_s=0.0 if not chosen.rate else 1.0,
        keyframe_overlap=overlap,
        image_size_px=size_px,
    ) as one:
        scenes = _mosaics(lap) if chosen.mosaics else cycle(lap)
        sent, stamp_ns = 0, 10**18
        begun_s = sampled_s = time.monotonic()
        until_s = begun_s + chosen.minutes * 60 if chosen.minutes else float('inf')
        while sent < (chosen.frames or float('inf')) and time.monotonic() < until_s:
            gray = next(scenes) + next(grain)
            stamp_ns += _PERIOD_NS
            one.publish(image(np.clip(gray, 0, 255).astype(np.uint8), stamp_ns))
            sent += 1
            if chosen.rate:
                one.spin(max(0.0, begun_s + sent / chosen.rate - time.monotonic()))
            elif not one.wait_for(partial(_has_answered, one, sent - _IN_FLIGHT), _PATIENCE_S):
                break
            if time.monotonic() - sampled_s > chosen.sample_s:
                sampled_s = time.monotonic()
                yield _sample(one, sent, sampled_s - begun_s)
        one.wait_for(lambda: unaccounted(one, sent) <= 0 and not one.count('queue'), _PATIENCE_S)
        yield _sample(one, sent, time.monotonic() - begun_s)


def _has_answered(one: Robot, count: int) -> bool:
    return one.answers >= count


def _sample(one: Robot, sent: int, seconds: float) -> Sample:
    took_ms, one.took_ms = one.took_ms or [0.0], []
    median_ms, worst_ms = round(float(np.median(took_ms)), 1), round(max(took_ms), 1)
    places, memory_mb = one.count('map_size'), round(one.resident_mb(), 1)
    held = places, memory_mb, one.number_of('fd'), one.number_of('task')
    lost = one.count('dropped'), one.count('lost_by_middleware'), one.count('failed')
    left = unaccounted(one, sent)
    return Sample(round(seconds, 1), sent, *held, median_ms, worst_ms, *lost, left)


def _picture(samples: Sequence[Sample], title: str, path: Path) -> None:
    figure: Any = new_figure(9, 7)
    figure.suptitle(title.replace(': ', ':\n', 1), fontsize=9, x=0.06, ha='left')
    panels = {
        'memory, MB': ('resident_mb',),
        'places': ('places',),
        'handles and threads': ('handles', 'threads'),
        'from image to answer, ms': ('median_ms', 'worst_ms'),
    }
    for number, (label, names) in enumerate(panels.items(), 1):
        axes = figure.add_subplot(len(panels), 1, number)
        for name in names:
            values = [getattr(one, name) for one in samples]
            axes.plot([one.seconds / 60 for one in samples], values, label=name.split('_')[0])
        axes.set_ylim(bottom=0)
        axes.set_title(label, fontsize=8, loc='left')
        if len(names) > 1:
            axes.legend(fontsize=7, frameon=False)
    axes.set_xlabel('minutes', fontsize=8)
    figure.tight_layout()
    save(figure, path)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, prog='soak', description=__doc__.splitlines()[1]
    )
    parser.add_argument('--mode', choices=('online', 'preloaded'), default='preloaded')
    parser.add_argument('--rate', type=float, default=0.0, help='Hz; 0: as fast as it can (0)')
    parser.add_argument('--frames', type=int, default=0, help='how many to send; 0: no limit')
    parser.add_argument('--minutes', type=float, default=0.0, help='how long; 0: no limit')
    parser.add_argument('--lap', type=int, default=350, help='frames of the drawn town (350)')
    parser.add_argument('--mosaics', action='store_true', help='places without end, from tiles')
    parser.add_argument('--width-px', type=int, default=640, help='of the camera, 4:3 (640)')
    parser.add_argument('--image-size-px', type=int, default=512, help='as the parameter (512)')
    parser.add_argument('--keyframe-overlap', type=float, default=0.75, help='as the parameter')
    parser.add_argument('--sample-s', type=float, default=_SAMPLE_S, help='between samples (5)')
    parser.add_argument('--output', type=Path, default=Path('soak'), help='folder to write (soak)')
    return parser


if __name__ == '__main__':
    sys.exit(main())
