# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print how often two similar aisles are confused.

Usage: python scripts/aisles.py [--metres 250] [--streets 1 2] [--alike 0] [--threads 1], two
minutes per street and share. Aisles A and B are drawn streets with the same lamps and house
shapes. The given share of houses has the same paint; trees, cars, signs and roads differ. The map
is made by day. The second drive is 0.4 m to the side, by day (odd streets) or in the evening,
without odometry. It covers B with only A mapped, both as mapped, and both in the other direction.
In the other direction no mapped place is visible; if B is `turned`, A backwards resembles mapped B
and B backwards resembles mapped A. A match is right in the same aisle within 5 m. At a share of 0,
twins lead over other places by as much as similar aisles of a real office. At 0.5, the lead is
that of a true place between day and night.
"""

from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from itertools import chain
import math

from convseq_ros import build_map, Config, Frame, PlaceRecognizer
from convseq_ros.config import make_config
from convseq_ros.core.types import Candidate
from convseq_ros.simulation.drive import Road
from convseq_ros.simulation.street import Spot, Street
from drives import head, options, PASSED_OVER, RIGHT_M, row, shots

MARGIN_M = 10.0  # of an aisle, before and after the driven part
LANE_M, ASIDE_M = -1.0, 0.4
NOISE = {'day': 1.0, 'evening': 2.0}
BACK = 'both the other way round', 'both the other way round, B turned'
Shown = list[tuple[tuple[str, float], Frame]]  # aisle, distance along it, and frame


@dataclass(frozen=True, slots=True)
class Turned:
    """A street that is driven from the other end."""

    street: Street

    @property
    def length_m(self) -> float:
        """The drivable length."""
        return self.street.length_m

    def spot(self, distance_m: float, offset_m: float, yaw_rad: float) -> Spot:
        """Return the spot at a distance, an offset to the left and a yaw, from the other end."""
        return self.street.spot(self.length_m - distance_m, -offset_m, yaw_rad + math.pi)


def driven(aisle: Road, name: str, again: str = '', back: bool = False) -> Shown:
    """Return frames 1 m apart with their positions; `again` is the light of a second drive."""
    light, lane_m = again or 'day', LANE_M + (ASIDE_M if again else 0.0)
    metres = round(aisle.length_m - 2 * MARGIN_M)
    drawn = shots(
        aisle, start_m=metres + MARGIN_M if back else MARGIN_M, speed_mps=-10.0 if back else 10.0,
        heading_deg=180.0 if back else 0.0, num_frames=metres, light=light, noise=NOISE[light],
        lane_offset_m=-lane_m if back else lane_m, seed=10 * ord(name) + 2 * bool(again) + back,
    )  # fmt: skip
    return [((name, at_m), replace(frame, pose=None)) for at_m, frame in drawn]


def one_drive(parts: tuple[Shown, ...]) -> Shown:
    """Return parts as one drive with 0.1 s between frames."""
    return [
        (place, replace(frame, stamp_ns=(index + 1) * 100_000_000))
        for index, (place, frame) in enumerate(chain.from_iterable(parts))
    ]


def recognised(mapped: Shown, queries: Shown, back: bool, config: Config) -> Counter[str]:
    """Recognise a drive in the map of another drive, and return the counts."""
    reference_map = build_map([frame for _, frame in mapped], None, config)
    there, here = ({one.stamp_ns: place for place, one in drive} for drive in (mapped, queries))

    def is_right(frame: Frame, match: Candidate) -> bool:
        (aisle, at_m), (true, true_m) = there[match.reference_stamp_ns], here[frame.stamp_ns]
        return aisle == true and abs(at_m - true_m) <= RIGHT_M and not back

    recognizer, counts = PlaceRecognizer(reference_map, config), Counter[str]()
    for _, frame in queries:
        match = recognizer.process(frame)
        counts['keyframes'] += match.reason not in PASSED_OVER
        if match.accepted:
            counts['right' if is_right(frame, match.accepted) else 'false'] += 1
    return counts


def main() -> None:
    """Draw, map, recognise, and print a table."""
    chosen = options(__doc__, metres=250, streets=[1, 2], alike=[0.0], threads=0)
    config = make_config({'threads': chosen.threads})
    results: dict[tuple[float, str], Counter[str]] = defaultdict(Counter)
    for street in chosen.streets:
        light = 'day' if street % 2 else 'evening'
        aisle = Street(chosen.metres + 2 * MARGIN_M, street)
        mapped, again, back = (
            driven(aisle, 'A'),
            driven(aisle, 'A', light),
            driven(aisle, 'A', light, True),
        )
        for share in chosen.alike:
            twin = replace(aisle, things_seed=1000 + street, alike=share)
            twin_mapped, twin_again = driven(twin, 'B'), driven(twin, 'B', light)
            turned = Turned(twin)
            for name, maps, queries in (
                ('B, A mapped', (mapped,), (twin_again,)),
                ('both again', (mapped, twin_mapped), (again, twin_again)),
                (BACK[0], (mapped, twin_mapped), (back, driven(twin, 'B', light, True))),
                (BACK[1], (mapped, driven(turned, 'B')), (back, driven(turned, 'B', light, True))),
            ):
                counts = recognised(one_drive(maps), one_drive(queries), name in BACK, config)
                results[share, name].update(counts, frames=sum(map(len, queries)))
    head('alike', 'driven', 'frames', 'keyframes', 'right', 'false')
    for (share, name), counts in results.items():
        cells = (counts[key] for key in ('frames', 'keyframes', 'right', 'false'))
        row(f'{share:g}', name, *cells)


if __name__ == '__main__':
    main()
