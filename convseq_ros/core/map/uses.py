# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the places of a map were good for: which were answers, and which are looks of others."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from threading import Lock


@dataclass(frozen=True, slots=True)
class Use:
    """Of one place."""

    look_of: int | None = (
        None  # the first place that shows the same; None if this one is the first
    )
    answers: int = 0  # matches that recognised it
    last_ns: int = 0  # stamp of the frame that it answered last; 0 if it was never an answer

    def is_off(self, end: int) -> bool:
        """Return whether this cannot be of a map of so many places."""
        numbers = self.look_of or 0, self.answers, self.last_ns
        return not all(isinstance(one, int) for one in numbers) or not 0 <= numbers[0] < end


_NONE = Use()


class Uses:
    """Of the places of a map by their indices; one thread may note some while others read."""

    def __init__(self, rows: Iterable[tuple[int, Use]] = ()) -> None:
        self._of, self._changed, self._lock = dict(rows), set[int](), Lock()

    def __len__(self) -> int:
        return len(self._of)

    def __getitem__(self, index: int) -> Use:
        return self._of.get(index, _NONE)

    @property
    def wait(self) -> bool:
        """Whether something was noted that was not taken yet."""
        return bool(self._changed)

    def first(self, index: int) -> int:
        """Return the first place that shows the same as a place."""
        look_of = self[index].look_of
        return index if look_of is None else look_of

    def answered(self, index: int, stamp_ns: int) -> None:
        """Note that a place was the answer to a frame."""
        use = self[index]
        self._note(index, replace(use, answers=use.answers + 1, last_ns=stamp_ns))

    def looks_like(self, index: int, other: int) -> None:
        """Note that a place shows the same as one that was there before."""
        self._note(index, replace(self[index], look_of=self.first(other)))

    def _note(self, index: int, use: Use) -> None:
        with self._lock:
            self._of[index] = use
            self._changed.add(index)

    def rows(self, end: int) -> list[tuple[int, Use]]:
        """Return what is known of the first places."""
        with self._lock:
            return [(index, self._of[index]) for index in sorted(self._of) if index < end]

    def take_changed(self, end: int) -> list[tuple[int, Use]]:
        """Return what changed of the first places since this was asked."""
        with self._lock:
            some = sorted(index for index in self._changed if index < end)
            self._changed.difference_update(some)
            return [(index, self._of[index]) for index in some]

    def put_back(self, rows: Iterable[tuple[int, Use]]) -> None:
        """Count rows as changed that could not be written."""
        with self._lock:
            self._changed.update(index for index, _ in rows)
