# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Looks for the topics of a camera that nobody has chosen."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from shlex import quote

from convseq_ros.node.offers import Offer, offers_of, Search
from convseq_ros.node.qos import steady_timer
from rclpy.node import Node

_PERIOD_S = 1.0  # discovery takes time: what is found twice in a row is used
_NAMES = 'image', 'camera_info', 'odom'


@dataclass(frozen=True, slots=True)
class Change:
    """Topics to listen to from now on."""

    topics: Mapping[str, str]  # by name: image, camera_info, odom
    gives_up: bool  # whether another topic was used before, which was the wrong one
    text: str  # says so, in one line


class TopicFinder:
    """
    Looks for `image`, `camera_info` and `odom` in the node's namespace, unless they are remapped.

    It goes on until `settle` is called, since a better camera may start late; `follow` receives
    the changes. One that stopped is waited for, unless a better one comes. `image_topics` are
    chosen; if they are several, so is `camera_info`.
    """

    def __init__(
        self, node: Node, follow: Callable[[Change], None], image_topics: Sequence[str] = ()
    ) -> None:
        self._node, self._follow = node, follow
        self._namespace = f'{node.get_namespace().rstrip("/")}/'
        self._used = {name: node.resolve_topic_name(name) for name in _NAMES}
        searched = [name for name in _NAMES if self._used[name] == self._default(name)]
        if image_topics:
            self._used['image'] = image_topics[0]
            chosen = ('image', 'camera_info')[: len(image_topics)]
            searched = [name for name in searched if name not in chosen]
        self._searched, self.is_settled = searched, not searched
        self._in_use: list[Offer] = []
        self._last: dict[str, list[str]] = {}
        self._reported: dict[str, list[str]] = {}
        self._timer = steady_timer(node, _PERIOD_S, self._search)

    def settle(self) -> None:
        """Keep the topics from now on; any thread may call this."""
        self.is_settled = True

    def cameras(self) -> list[str]:
        """Return the topics of the best cameras in the namespace or, without any, elsewhere."""
        search = Search(offers_of(self._node), self._namespace)
        return search.images() or replace(search, namespace='/').images()

    def _search(self) -> None:
        if self.is_settled:
            self._timer.cancel()
            return
        offers = offers_of(self._node)
        topics = {offer.topic for offer in offers}
        offers += [offer for offer in self._in_use if offer.topic not in topics]
        found, before = self._find(offers), self._last
        self._last = found
        if found == before:
            self._report(found)
            self._use({name: self._choice(name, topics) for name, topics in found.items()})
        self._in_use = [offer for offer in offers if offer.topic in self._used.values()]

    def _find(self, offers: Sequence[Offer]) -> dict[str, list[str]]:
        """Return the best topics by name; only those of `image` while it is not published."""
        search = Search(offers, self._namespace)
        found = {'image': search.images()} if 'image' in self._searched else {}
        image = self._choice('image', found['image']) if found else self._used['image']
        if any(offer.topic == image for offer in offers):
            if 'camera_info' in self._searched:
                found['camera_info'] = search.camera_infos(image)
            if 'odom' in self._searched:
                found['odom'] = search.odometries(image)
        return found

    def _choice(self, name: str, topics: Sequence[str]) -> str:
        """Return the topic to use, given the best ones: none of several unless it is in use."""
        used = self._used[name]
        if len(topics) == 1:
            return topics[0]
        # The calibration of one camera fits no other.
        is_kept = used in topics or not (topics or name == 'camera_info')
        return used if is_kept else self._default(name)

    def _use(self, topics: Mapping[str, str]) -> None:
        new = {name: topic for name, topic in topics.items() if topic != self._used[name]}
        if not new:
            return
        given_up = {name: it for name in new if (it := self._used[name]) != self._default(name)}
        said = [
            f'{name} on {topic}' + (f' instead of {given_up[name]}' if name in given_up else '')
            for name, topic in new.items()
        ]
        self._used |= new
        text = f'found {", ".join(said)}; to choose another, -r NAME:=TOPIC'
        self._follow(Change(new, 'image' in new or bool(given_up), text))

    def _report(self, found: Mapping[str, Sequence[str]]) -> None:
        """Name topics that are equally good, once."""
        several = {name: list(topics) for name, topics in found.items() if len(topics) > 1}
        for name, topics in several.items():
            if topics != self._reported.get(name):
                choices = ' or '.join(f'-r {name}:={quote(topic)}' for topic in topics)
                text = f'{name}: {len(topics)} topics could be meant; to use one: {choices}'
                self._node.get_logger().warning(text)
        self._reported |= several

    def _default(self, name: str) -> str:
        return f'{self._namespace}{name}'
