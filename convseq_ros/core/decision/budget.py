# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much work a frame is worth: how many places are scored, verified and asked."""

from convseq_ros.core.types import constants


@constants
class BUDGET:
    """Numbers that bound the time of a frame. With more, answers should hardly change."""

    # The first frames of a drive, up to its first match, search more places, as the mean
    # descriptor of the drive is not known yet: on drawn nights, a median of 130 of 1,083 places
    # have a better coarse score than the right one.
    first_frames: int = 15
    first_listed: int = 400  # in the first frames: listed by the newest frame alone
    # The listed places that get a full pair score, the best by rough scores. On `laps`,
    # 8 lose 2 % of the matches, and 16 gain nothing.
    scored: int = 12  # also the likeliest other places that count by their share of a scene
    first_scored: int = 30  # in the first frames
    peaks: int = 6  # best by pair score, apart from each other: they are verified. As many places,
    # the likeliest by the predicted belief, are always scored ...
    checked: int = 2  # ... and this many of them are always verified
    asked: int = 3  # places, apart from each other, whose keypoints are compared; the likeliest,
    # too. None is, if cells agree with the belief, and its doubt is at most this share of what a
    # match may leave.
    doubt: float = 0.1
    seen: int = 60  # images of a session, evenly spread, whose brightness is read
    least: float = 1e-9  # mass below which a place is dropped
    # Mass from which on a place shares with its looks, or counts by its share of a scene.
    shares_from: float = 1e-3
    widest: float = 20.0  # places; a larger sigma of the motion is cut off at 3 times this
