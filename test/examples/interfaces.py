# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of back ends that cannot run here, from `interfaces.msg` beside this file."""

from pathlib import Path
from typing import Any


def type_store() -> Any:
    """Return a store of rosbags that knows all of these, and those of Jazzy."""
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores

    store, types = get_typestore(Stores.ROS2_JAZZY), {}
    _, *messages = Path(__file__).with_suffix('.msg').read_text('utf-8').split('\n=== ')
    for message in messages:
        name, _, fields = message.partition('\n')
        types.update(get_types_from_msg(fields, name))
    store.register(types)
    return store


def blank(store: Any, name: str, **fields: Any) -> Any:
    """Return a message whose other fields are zero, empty, or blank messages."""
    import numpy as np
    from rosbags.interfaces import Nodetype

    def value(described: Any) -> Any:
        kind, of = described
        if kind == Nodetype.BASE:
            return {'string': '', 'bool': False}.get(of[0], 0.0 if 'float' in of[0] else 0)
        if kind == Nodetype.NAME:
            return blank(store, of)
        (_, inner), count = of
        number = inner[0] if isinstance(inner, tuple) else None
        if number in (None, 'string'):
            return [value(of[0]) for _ in range(count or 0)]
        return np.zeros(count or 0, number)

    _, described = store.fielddefs[name]
    made = {item: fields[item] if item in fields else value(kind) for item, kind in described}
    return store.types[name](**made)
