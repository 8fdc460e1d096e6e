# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The methods: each is a row of `KINDS`, and a function of a data set that gives `PairScores`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
import math
from pathlib import Path
import re
import shlex
import time
from typing import TypeVar

from convseq_ros.baselines import seqslam
from convseq_ros.baselines.local_features import ROWS
from convseq_ros.baselines.loop_detector import ALPHA
from convseq_ros.baselines.vocabulary import LEVELS
from convseq_ros.baselines.whole_image_hog import whole_image_hog
from convseq_ros.config import Config, core_parameters
from convseq_ros.config.paper import PAPER
from convseq_ros.config.parameter import refuse_unknown, Value
from convseq_ros.core.encoding.mask import masked
from convseq_ros.errors import ConfigError, load
from convseq_ros.evaluation import peers
from convseq_ros.evaluation.cache import Made
from convseq_ros.evaluation.given_files import read_descriptors, read_scores
from convseq_ros.evaluation.given_scores import PairScores
from convseq_ros.evaluation.images import described, Images
from convseq_ros.evaluation.material import Material
from convseq_ros.evaluation.query_answers import (
    After,
    alone,
    overridden,
    QueryAnswers,
    recognize,
    verified,
)
from convseq_ros.io.mask_file import read_mask
from convseq_ros.models.onnx_model import OnnxModel
import numpy as np
import numpy.typing as npt

Number = TypeVar('Number', int, float)
Gray = npt.NDArray[np.uint8]
Vectors = npt.NDArray[np.float32]  # (N, n), a descriptor an image
# The recogniser takes the scores of a baseline, and accepts every best candidate.
_GIVEN: Mapping[str, Value] = {
    'matching': 'regional',
    'search': 'exhaustive',
    'acceptance_rule': 'always',
}


@dataclass(frozen=True, slots=True)
class MethodName:
    """A method as requested: a name and its options."""

    label: str  # for tables and folders
    kind: str  # key of `KINDS`
    options: Mapping[str, str] = field(default_factory=dict)  # and core parameters
    length: int | None = None  # k: 0 for dynamic, None for the method's default

    def number(
        self, kind: Callable[[str], Number], key: str, default: Number, least: float = -math.inf
    ) -> Number:
        """Return an option, a number of at least `least`; ConfigError for any other text."""
        text = self.options.get(key, str(default))
        try:
            number = kind(text)
            if math.isnan(number):
                raise ValueError
        except ValueError:
            raise ConfigError(f'method {self.label}: {key} is not a number: {text!r}') from None
        if number < least:
            raise ConfigError(f'method {self.label}: {key} is {text}; give at least {least:g}')
        return number


def parse_method(text: str) -> MethodName:
    """
    Parse a name and options, such as `convseq k=10 label=ours`; ConfigError if unclear.

    `label` is by default the name with the values of the options; `k` is a number or `dynamic`.
    """
    try:
        kind, *words = shlex.split(text)
        options = dict(word.split('=', 1) for word in words)
    except ValueError:
        raise ConfigError(
            f'method {text!r}: expected a name and options, for example convseq, '
            "'convseq k=10' or 'scores file=net.npy k=dynamic label=net'"
        ) from None
    if len(options) < len(words):
        raise ConfigError(f'method {text!r}: gives an option twice; leave one out')
    parts = [f'{key * value.isdigit()}{value}' for key, value in options.items()]
    label = options.pop('label', '') or re.sub(r'[^\w.-]+', '_', '-'.join([kind, *parts]))
    if not re.fullmatch(r'\w[\w.-]*', label):
        raise ConfigError(
            f'method {text!r}: label {label!r} is no folder name; use letters, digits'
        )
    length = options.pop('k', None)
    if length not in (None, 'dynamic') and not re.fullmatch('[0-9]+', length):
        raise ConfigError(f'method {label}: k is a number or dynamic, not {length!r}')
    k = None if length is None else 0 if length == 'dynamic' else int(length)
    return MethodName(label, kind, options, k)


@dataclass(frozen=True, slots=True)
class Sweep:
    """Values of an option, with each of which every method is run."""

    option: str
    values: range

    @classmethod
    def parse(cls, text: str) -> 'Sweep':
        """Return the sweep of a text such as `k=1..20`; ConfigError for another text."""
        found = re.fullmatch(r'(\w+)=([0-9]{1,4})\.\.([0-9]{1,4})', text)
        if not found or int(found[3]) < int(found[2]):
            raise ConfigError(
                f'--sweep: {text!r} is no option and range; give one such as k=1..20'
            )
        return cls(found[1], range(int(found[2]), int(found[3]) + 1))

    def methods(self, texts: Sequence[str]) -> list[str]:
        """Return every method with each value in turn; the value ends its label."""
        labels = {text: parse_method(text).label for text in texts}
        return [
            f'{re.sub("label=[^ ]*", "", text)} {self.option}={value} '
            f'label={label}-{self.option}{value}'
            for text, label in labels.items()
            for value in self.values
        ]


@dataclass(frozen=True, slots=True)
class Kind:
    """A row of the registry."""

    rows: Callable[[Material, MethodName, Config], PairScores]
    length: int | None = 1  # default k, as in `MethodName`
    settings: Mapping[str, Value] = field(default_factory=dict)  # required core parameters
    options: tuple[str, ...] = ()  # options of the method
    files: tuple[str, ...] = ()  # options that it needs
    takes_length: bool = True  # whether another k makes sense
    instead: str = ''  # what to give, if it does not
    recognizer: bool = False  # whether the online recogniser decides
    after: After | None = None  # as in `recognize`
    needs: str = ''  # a module


@dataclass(frozen=True, slots=True)
class Method:
    """A requested method, with its configuration."""

    name: MethodName
    kind: Kind
    config: Config

    def rows(self, material: Material) -> PairScores:
        return self.kind.rows(material, self.name, self.config)

    def measured(self, material: Material, answered: QueryAnswers) -> PairScores:
        """Return the recogniser's pair scores with their time and memory costs."""
        query, reference = material.drives(self.config.encoding)
        encode_ms, reference_map = query.encode_ms, reference.reference_map
        row_ms = max(0.0, float(np.median(answered.durations_ms)) - encode_ms)
        place_bytes: float = reference_map.global_descriptors[0].nbytes
        place_bytes += reference_map.packed(0).nbytes
        if self.config.believes:  # it asks keypoints now and then; here they count for each frame
            encode_ms += query.keypoints_ms
            stored = (one.keypoints for one in reference.descriptors)
            place_bytes += float(np.mean([0 if one is None else one.nbytes for one in stored]))
        return PairScores(answered.rows, encode_ms, row_ms, place_bytes=place_bytes)


def make_method(name: MethodName, config: Config) -> Method:
    """Return the method of a name; ConfigError if it, an option or its package is missing."""
    if name.kind not in KINDS:
        raise ConfigError(f'method {name.kind!r} is not one of {", ".join(KINDS)}')
    kind = KINDS[name.kind]
    if kind.needs:
        load(kind.needs, f'method {name.label}:', ConfigError)
    for needed in kind.files:
        if needed not in name.options:
            raise ConfigError(f'method {name.label}: add {needed}=FILE')
    length = name.number(int, 'ds', seqslam.LENGTH, 1) if 'ds' in kind.options else kind.length
    if not kind.takes_length and name.length not in (None, length):
        remedy = kind.instead or 'leave it out'
        raise ConfigError(f'method {name.label}: {name.kind} takes no k; {remedy}')
    # The set says whether the map grows.
    core = {item.name: item for item in core_parameters() if item.name != 'mode'}
    own = (*kind.files, *kind.options)
    known = [*own, *core]
    refuse_unknown(name.options, known, f'method {name.label}: unknown option')
    values = {
        option: core[option].parse(text)
        for option, text in name.options.items()
        if option not in own
    }
    length = length if name.length is None else name.length
    if length is not None:
        values.setdefault('fixed_length', length)
    chosen = overridden(config, {**kind.settings, **values})
    if values.get('fixed_length') and chosen.believes and 'acceptance_rule' not in values:
        # A fixed length decides by the margin of its frames; the belief would use all past frames.
        chosen = overridden(chosen, {'acceptance_rule': 'margin'})
    return Method(name, kind, masked(chosen, read_mask(chosen)))


def _core(material: Material, name: MethodName, config: Config) -> PairScores:
    """Return the recogniser's pair scores of all pairs, from an exhaustive search."""
    exhaustive = overridden(config, {'search': 'exhaustive'})
    method = Method(name, KINDS[name.kind], exhaustive)
    return method.measured(material, recognize(material, exhaustive, after=method.kind.after))


def _seqslam(material: Material, _name: MethodName, _config: Config) -> PairScores:
    query, reference, encode_ms = _descriptors(material, seqslam.patch_normalized, 'seqslam')
    started = time.perf_counter()
    scores = seqslam.enhanced(seqslam.differences(query, reference))
    row_ms = (time.perf_counter() - started) * 1e3 / len(query)
    scorer = seqslam.trajectory_scores
    return PairScores(scores, encode_ms, row_ms, scorer, place_bytes=reference[0].nbytes)


def _hog(material: Material, _name: MethodName, _config: Config) -> PairScores:
    return _by_cosine(*_descriptors(material, whole_image_hog, 'hog'))


def _onnx(material: Material, name: MethodName, config: Config) -> PairScores:
    how = {key: value for key, value in name.options.items() if key != 'file'}
    model = OnnxModel(Path(name.options['file']), config.reading, how)
    return _by_cosine(*_descriptors(material, model, (model.identity, how)))


def _peer(material: Material, name: MethodName, config: Config) -> PairScores:
    alpha, rows = name.number(float, 'alpha', ALPHA), name.number(int, 'rows', ROWS, 0)
    vocabulary = name.options.get('vocabulary', '')
    levels = name.number(int, 'levels', LEVELS, 1)
    direct = name.number(int, 'direct', 0, 0) if 'direct' in name.options else None
    return peers.peer_scores(
        material, name.kind, alpha, vocabulary, config.reading, rows, levels, direct
    )


def _hbst(material: Material, name: MethodName, _: Config) -> PairScores:
    return peers.tree_scores(material, name.number(int, 'rows', ROWS, 0))


def _given_scores(material: Material, name: MethodName, config: Config) -> PairScores:
    lower = name.options.get('lower_is_better', 'false')
    if lower not in ('true', 'false'):
        raise ConfigError(f'method {name.label}: lower_is_better is true or false, not {lower!r}')
    queries, references = material.truth.right.shape
    scores = read_scores(Path(name.options['file']), queries, references, config.reading)
    return PairScores(-scores if lower == 'true' else scores)


def _given_descriptors(material: Material, name: MethodName, config: Config) -> PairScores:
    queries, references = material.truth.right.shape
    query = read_descriptors(Path(name.options['query']), queries, config.reading)
    path = name.options.get('reference', name.options['query'])
    reference = read_descriptors(Path(path), references, config.reading)
    if query.shape[1] != reference.shape[1]:
        raise ConfigError(
            f'method {name.label}: descriptors of {query.shape[1]} and {reference.shape[1]} '
            'numbers cannot be compared; compute both with one model'
        )
    return _by_cosine(query, reference)


def _descriptors(
    material: Material, describe: Callable[[Gray], Vectors], what: object
) -> tuple[Vectors, Vectors, float]:
    """
    Return query and reference descriptors, and the median time per query in ms.

    `repr(what)` says which function describes an image.
    """

    def of(images: Images) -> Made:
        rows, median_ms = described(images, describe)
        zeros = np.zeros_like(next(row for row in rows if row is not None))
        vectors = [zeros if row is None else row for row in rows]
        return Made({'encode_ms': median_ms}, {'vectors': vectors})

    query, reference = material.each(lambda images: images.once(what, lambda: of(images)))
    vectors = (np.stack(made.rows['vectors']) for made in (query, reference))
    return *vectors, query.facts['encode_ms']


def cosine_scores(
    queries: npt.NDArray[np.float32], references: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Return the cosine of queries (Q, D) and references (R, D), 0 for a zero vector: (Q, R)."""
    return _unit(queries) @ _unit(references).T


def _unit(rows: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    length = np.linalg.norm(rows.astype(np.float64), axis=1, keepdims=True)
    return np.divide(rows, length, out=np.zeros_like(rows), where=length > 0)


def _by_cosine(query: Vectors, reference: Vectors, encode_ms: float | None = None) -> PairScores:
    started = time.perf_counter()
    scores = cosine_scores(query, reference)
    row_ms = (time.perf_counter() - started) * 1e3 / len(query)
    return PairScores(scores, encode_ms, row_ms, place_bytes=reference[0].nbytes)


_OURS: Mapping[str, Value] = {'matching': 'coherent', 'search': 'exhaustive'}
_baseline = partial(Kind, settings=_GIVEN)
_single = partial(Kind, _core, 1, _OURS, takes_length=False, recognizer=True)
_peer_of = partial(_baseline, takes_length=False)

KINDS: Mapping[str, Kind] = {
    'convseq': Kind(_core, None, recognizer=True),
    'single': _single(after=alone),
    'verified': _single(after=verified),
    'paper': Kind(_core, None, PAPER, recognizer=True),
    'cohog': Kind(_core, 1, PAPER, takes_length=False, recognizer=True, instead='paper does'),
    'seqslam': _baseline(
        _seqslam, seqslam.LENGTH, options=('ds',), takes_length=False, instead='give ds, its own'
    ),
    'hog': _baseline(_hog, needs='skimage'),
    'orb-bow': _peer_of(_peer, options=peers.OPTIONS + peers.TREE_OPTIONS),
    'sift-vlad': _peer_of(_peer, options=peers.OPTIONS),
    'hbst': _peer_of(_hbst, options=('rows',), needs='pyhbst'),
    'scores': _baseline(_given_scores, files=('file',), options=('lower_is_better',)),
    'descriptors': _baseline(_given_descriptors, files=('query',), options=('reference',)),
    'onnx': _baseline(_onnx, files=('file',), options=('size', 'mean', 'scale')),
}
