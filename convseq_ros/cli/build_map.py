# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Build a reference map: `convseq build-map RECORDING MAP`."""

import argparse
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from itertools import chain
import json
from pathlib import Path
import sys
import time
from typing import Any

from convseq_ros.app.cameras import of_camera
from convseq_ros.app.map_builder import MapBuilder
from convseq_ros.cli.options import (
    add_images,
    add_max_looks,
    chosen_images,
    note,
    progress,
    quoted,
    refuse_name,
    say,
    tells_what_is_kept,
    warn,
)
from convseq_ros.cli.parameter_file import read_parameter_file
from convseq_ros.cli.recording import describe_recording
from convseq_ros.config import (
    Config,
    EncodingConfig,
    KeyframeConfig,
    make_config,
    MatchingConfig,
    MotionConfig,
    RobotConfig,
)
from convseq_ros.config.parameter import add_parameters, given, Parameter, parameters
from convseq_ros.config.reading_config import chosen_reading, ReadingConfig
from convseq_ros.core.encoding.mask import masked
from convseq_ros.core.types import Frame
from convseq_ros.errors import ConfigError, printable, SourceError
from convseq_ros.io.mask_file import read_mask
from convseq_ros.models.onnx_model import open_model
from convseq_ros.sources import open_each_camera, Source
from convseq_ros.sources.recording_names import recordings_in

_MANY, _FEW = 30, 3  # frames, and places of them, that are worth a warning


@dataclass(slots=True)
class Built:
    """What came of a build."""

    map: str
    frames: int = 0
    added: int = 0
    references: int = 0
    unreadable: int = 0
    with_pose: int = 0
    seconds: float = 0.0
    bytes: int = 0
    interrupted: bool = False

    def add(
        self, builder: MapBuilder, frames: Iterable[Frame], report: Callable[[str], None]
    ) -> str:
        """Build a session of frames, until interrupted; return why the last unreadable one is."""
        problem = ''
        try:
            with builder:
                for frame in frames:
                    self.frames += 1
                    if frame.gray is None:
                        self.unreadable += 1
                        problem = frame.problem
                        report(problem)
                    self.with_pose += builder.process(frame) and frame.pose is not None
        except KeyboardInterrupt:
            self.interrupted = True
        self.added += builder.added
        return problem


def describe(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('recording', type=Path, help='recording or folder of images')
    parser.add_argument('map', type=Path, help='map file to make; each camera makes a session')
    add_images(parser)
    parser.add_argument('--append', action='store_true', help='add a session to an existing map')
    help_ = 'the recording is a folder of recordings; each makes a session'
    parser.add_argument('--each', action='store_true', help=help_)
    parser.add_argument('--session', help='name of the session (default: that of the recording)')
    help_ = 'frame of its poses, if other sessions share it'
    parser.add_argument('--pose-frame', metavar='NAME', help=help_)
    add_no_links(parser)
    add_max_looks(parser)
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    add_settings(parser)


def add_no_links(parser: argparse.ArgumentParser) -> None:
    """Declare the option that leaves out recognition."""
    help_ = 'do not recognise places that are passed again: quicker, and vpr_node does it later'
    parser.add_argument('--no-links', action='store_true', help=help_)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Declare the options that decide which images become places."""
    help_ = 'parameter file, the same YAML that the node reads; options win over it'
    parser.add_argument('--config', type=Path, metavar='FILE', help=help_)
    for title, declared in _settings().items():
        add_parameters(parser, title, declared)


def chosen_settings(chosen: argparse.Namespace) -> Config:
    """Return the configuration that these arguments ask for."""
    declared = [*chain.from_iterable(_settings().values())]
    values = given(chosen, declared)
    if chosen.config:
        names = [item.name for item in declared]
        file = read_parameter_file(chosen.config, chosen_reading(chosen))
        values = {name: file[name] for name in names if name in file} | values
    config = make_config(values)
    return masked(config, read_mask(config))


def run(chosen: argparse.Namespace) -> int:
    """Build a map, and print the result."""
    if chosen.max_looks and chosen.no_links:
        raise ConfigError('max_looks: needs links; leave out --no-links')
    if chosen.each and chosen.session is not None:
        raise ConfigError('--each: sessions are named by their recordings; leave out --session')
    if chosen.session is not None:
        refuse_name(chosen.session)
    if chosen.pose_frame is not None and (why := _why_no_pose(chosen)):
        raise ConfigError(f'--pose-frame: {why}')
    with tells_what_is_kept(chosen.map):
        built = build(
            chosen.recording,
            chosen.map,
            chosen_settings(chosen),
            each=chosen.each,
            append=chosen.append,
            session=chosen.session,
            pose_frame=chosen.pose_frame,
            links=not chosen.no_links,
            max_looks=chosen.max_looks,
            **chosen_images(chosen),
        )
    if chosen.json:
        print(json.dumps(asdict(built)))
    else:
        say(
            f'{built.map}: {built.references} references, {built.bytes / 1e6:.1f} MB; '
            f'{built.added} added, {built.with_pose} with a pose, from {built.frames} frames '
            f'at {built.frames / max(built.seconds, 1e-9):.0f} frames/s'
        )
        if built.frames >= _MANY and built.added < _FEW:
            warn(
                f'{built.map}: only {built.added} of {built.frames} frames became places, too few '
                'to recognise a drive; the others show nothing new by this image_size_px and '
                'keyframe_overlap'
            )
        if why := _why_no_pose(chosen):
            print(why)
    if built.interrupted:
        print('convseq build-map: interrupted; the map holds what was added', file=sys.stderr)
    return int(built.interrupted)


def build(
    recording: Path,
    path: Path,
    config: Config = Config(),
    *,
    each: bool = False,
    append: bool = False,
    session: str | None = None,
    pose_frame: str = '',
    links: bool = True,
    max_looks: int = 0,
    on_warning: Callable[[str], None] | None = None,
    **images: Any,
) -> Built:
    """
    Build a map file, or add to one; `images` are arguments of `open_each_camera`.

    Each of several topics makes a session; with `each`, so does each recording in a folder.
    Warnings and progress go to standard error, or only warnings to `on_warning`. SourceError or
    MapError if a file is unusable; a map keeps what was added before.
    """
    model = open_model(config)
    recordings = recordings_in(recording) if each else [recording]
    sessions = _sessions(recordings, session, config.reading, images)
    config.robot.refuse_count(1 + max(number for _, number, _ in sessions))
    started, report, built = time.monotonic(), on_warning or warn, Built(str(path))
    for name, number, source in sessions:
        is_first, before = source is sessions[0][2], built.frames
        adds, own = append or not is_first, of_camera(config, number)
        builder = MapBuilder(path, own, adds, name, pose_frame, links, max_looks, model)
        frames = source if on_warning else progress(source, len(source), path.name)
        problem = built.add(builder, frames, report)
        check = builder.camera_check
        if check.note and not on_warning:
            note(check.note)
        for warning in filter(None, [check.problem, *source.warnings]):
            report(warning)
        if built.interrupted:
            if not built.added:
                raise KeyboardInterrupt
            break
        if not builder.added:
            images_of = 'images' if is_first else f'images of {source.topic or source.name}'
            shown = f'{built.frames - before} {images_of}'
            why = f': {problem}' if problem else ''
            raise SourceError(f'{recording}: none of its {shown} could be used{why}')
    built.references = len(builder.reference_map) - builder.removed
    built.seconds, built.bytes = time.monotonic() - started, path.stat().st_size
    return built


def _sessions(
    recordings: list[Path], session: str | None, reading: ReadingConfig, images: dict[str, Any]
) -> list[tuple[str, int, Source]]:
    """Return a name, the number of the camera, and the frames of each session."""
    found: list[tuple[str, int, Source]] = []
    for recording in recordings:
        cameras = open_each_camera(recording, reading=reading, **images)
        name = printable(recording.stem) if session is None else session
        for number, camera in enumerate(cameras):
            called = f'{name} {camera.topic}' if len(cameras) > 1 else name
            found.append((called, number, camera))
    return found


def _why_no_pose(chosen: argparse.Namespace) -> str:
    """Return why no place has a pose, and the remedy; empty if poses were asked for."""
    if chosen.odom or chosen.poses:
        return ''
    topics: list[str] = []
    if not chosen.each:
        facts = describe_recording(chosen.recording, chosen_reading(chosen))
        topics = facts.get('use', {}).get('--odom', [])
    remedy = ' or '.join(f'--odom {quoted(topic)}' for topic in topics)
    return f'no poses: none were asked for; add {remedy or "--odom TOPIC or --poses FILE"}'


def _settings() -> dict[str, list[Parameter]]:
    """Return the parameters of places and of the content of maps, by title."""
    kept = (
        'image_size_px', 'resize', 'image_mask', 'image_rotation_deg', 'descriptor_model',
        'matching',
    )  # fmt: skip
    encoding = [*parameters(EncodingConfig), *parameters(MatchingConfig)]
    return {
        'keyframes': [*parameters(KeyframeConfig)],
        'motion': [*parameters(MotionConfig)],
        'images': [item for item in encoding if item.name in kept] + [*parameters(ReadingConfig)],
        'robot': [item for item in parameters(RobotConfig) if item.name == 'camera_to_base'],
    }
