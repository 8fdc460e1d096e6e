# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A network in ONNX as a function from an image to a vector, run by the optional onnxruntime."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
import hashlib
from pathlib import Path
import re
from typing import Any

from convseq_ros.config import Config
from convseq_ros.config.reading_config import ReadingConfig
from convseq_ros.core.encoding.first_stage import checked_vector
from convseq_ros.errors import load, ModelError, one_line, SourceError
from convseq_ros.io.files import read_yaml
from convseq_ros.io.regular_file import read_bytes
import cv2
import numpy as np
import numpy.typing as npt

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_SCALE = (0.229, 0.224, 0.225)
_TYPES = {'tensor(float)': np.float32, 'tensor(float16)': np.float16}
_ELSEWHERE = 'AzureExecutionProvider'  # would send images to a server


@dataclass(frozen=True, slots=True)
class Input:
    """How images become a network's input: (value / 255 - mean) / scale; None if not given."""

    size: tuple[int, int] | None = None  # height and width
    mean: tuple[float, ...] | None = None  # one, or one for each channel
    scale: tuple[float, ...] | None = None  # as `mean`; the standard deviation of most networks

    @classmethod
    def of(cls, settings: Mapping[str, Any], where: object) -> 'Input':
        """Return the input that settings, texts or lists, describe; ModelError if invalid."""
        try:
            names = {item.name for item in fields(cls)}
            if unknown := [*settings.keys() - names]:
                raise ValueError(f'{unknown[0]!r} is none of {", ".join(sorted(names))}')
            numbers = {name: _numbers(settings[name]) for name in settings}
            if not all(numbers.get('scale', ())):
                raise ValueError('scale is not 0')
            size: Any = tuple(map(int, numbers.pop('size', ()))) or None
            if size and (len(size) > 2 or min(size) < 1 or max(size) > 4096):
                raise ValueError(f'size {size} is not height and width, 1 to 4096 px')
            return cls(size=size and (size[0], size[-1]), **numbers)
        except (TypeError, ValueError) as error:
            raise ModelError(f'{where}: {error}') from None

    def with_others(self, other: 'Input', where: object) -> 'Input':
        """Return both merged; ModelError if they contradict each other."""
        both: dict[str, Any] = {}
        for name, value in (*asdict(self).items(), *asdict(other).items()):
            if value is not None and both.setdefault(name, value) != value:
                raise ModelError(
                    f'{where}: {name} {value} contradicts the model, which says {both[name]}; '
                    'take it out of one of them'
                )
        return Input(**both)


class OnnxModel:
    """
    A network that turns an image into a descriptor, a vector of `numbers` elements.

    Its input is float (1, C, H, W) with 1 channel, or 3 that all get the grey image; its first
    output, of any shape, is the vector. `size`, `mean` and `scale` of the input come from the
    model's metadata, from a YAML file of the same name beside it, or from `given`; the defaults
    are those of ImageNet. Weights may lie beside it, in `NAME.onnx.data`, where PyTorch writes
    them. `identity` is the SHA-256 of these files. ModelError if onnxruntime is missing, or if the
    model is larger than `reading` allows, is damaged, has other files, custom operators or another
    input, or fails on an image.
    """

    def __init__(
        self,
        path: Path,
        reading: ReadingConfig = ReadingConfig(),
        given: Mapping[str, object] | None = None,
    ) -> None:
        onnxruntime = load('onnxruntime', f'{path}:', ModelError)
        self._path, self.numbers = path, 0
        beside, weights = path.with_suffix('.yaml'), b''
        try:
            data = read_bytes(path, 'an ONNX model', reading.refuse_file)
            if (file := _weights_of(path)).is_file():
                weights = read_bytes(file, 'weights', reading.refuse_file)
            digest = hashlib.sha256(data + weights)
            chosen = Input.of(given or {}, path)
            if beside.is_file():
                digest.update(read_bytes(beside, 'a description', reading.refuse_file))
                chosen = chosen.with_others(Input.of(read_yaml(beside, reading), beside), beside)
        except SourceError as error:
            raise ModelError(str(error)) from None
        self.identity = digest.hexdigest()
        self._session = self._opened(onnxruntime, data, weights)
        metadata = self._session.get_modelmeta().custom_metadata_map
        names = metadata.keys() & {item.name for item in fields(Input)}
        in_model = Input.of({name: metadata[name] for name in names}, path)
        where = beside if beside.is_file() else path
        self._configure(self._graph_input().with_others(in_model, path).with_others(chosen, where))
        drawn = np.random.default_rng(0).integers(0, 256, self._size, np.uint8)
        self.numbers = len(self(drawn))

    def __call__(self, image: npt.NDArray[np.uint8], /) -> npt.NDArray[np.float32]:
        """
        Return the vector (n,) of a grey image, uint8 (H, W).

        ModelError if the model fails, or its vector holds NaN or has another length than before.
        """
        return checked_vector(self._run(image), self.numbers, self._path)

    def _run(self, image: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
        """Return the model's first output for an image."""
        planes = self._planes(image)[None]
        try:
            return np.asarray(self._session.run(None, {self._input: planes})[0], np.float32)
        except Exception as error:
            height, width = self._size
            raise ModelError(
                f'{self._path}: the model fails on an image of {height} x {width} px '
                f'({one_line(error)}); is that its size?'
            ) from None

    def _planes(self, image: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
        """Return an image as the model reads it, (C, H, W)."""
        height, width = self._size
        small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        planes = np.repeat(small[None], self._channels, axis=0) / 255.0
        return ((planes - self._mean) / self._scale).astype(self._type)

    def _opened(self, onnxruntime: Any, data: bytes, weights: bytes) -> Any:
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4
        # Threads that wait for the next image leave the cores to others.
        options.add_session_config_entry('session.intra_op.allow_spinning', '0')
        providers = [name for name in onnxruntime.get_available_providers() if name != _ELSEWHERE]
        try:
            if weights:
                options.add_external_initializers_from_files_in_memory(
                    [_weights_of(self._path).name], [weights], [len(weights)]
                )
            # Of a model without a path, onnxruntime reads no other file.
            return onnxruntime.InferenceSession(data, options, providers=providers)
        except Exception as error:
            raise ModelError(
                f'{self._path}: not an ONNX model that onnxruntime can load ({one_line(error)}); '
                f'export it with standard operators, its weights in it or in '
                f'{_weights_of(self._path).name}'
            ) from None

    def _graph_input(self) -> Input:
        """Return the input as the graph declares it."""
        inputs = self._session.get_inputs()
        shape = inputs[0].shape if inputs else []
        fitting = len(inputs) == 1 and len(shape) == 4 and inputs[0].type in _TYPES
        sides = [side if isinstance(side, int) and side > 0 else None for side in shape]
        if not fitting or sides[0] not in (None, 1) or sides[1] not in (None, 1, 3):
            actual = '; '.join(f'{item.name} {item.type} {item.shape}' for item in inputs)
            raise ModelError(
                f'{self._path}: its input is {actual[:200] or "missing"}; expected one float '
                'tensor of shape (1, 1 or 3, height, width)'
            )
        self._input, self._type = inputs[0].name, _TYPES[inputs[0].type]
        self._channels: int = sides[1] or 3
        height, width = sides[2:]
        size = (height, width) if height and width else None
        return Input(size)

    def _configure(self, described: Input) -> None:
        """Set how images become the network's input."""
        if described.size is None:
            raise ModelError(
                f'{self._path}: takes images of any size; say `size: [height, width]` in '
                f'{self._path.with_suffix(".yaml").name}'
            )
        self._size = described.size
        self._mean = self._per_channel(described.mean, IMAGENET_MEAN)
        self._scale = self._per_channel(described.scale, IMAGENET_SCALE)

    def _per_channel(
        self, values: Sequence[float] | None, default: Sequence[float]
    ) -> npt.NDArray[np.float64]:
        if values is None:
            values = default if self._channels == 3 else [float(np.mean(default))]
        if len(values) not in (1, self._channels):
            raise ModelError(
                f'{self._path}: {len(values)} values of mean or scale for {self._channels} '
                'channels; give one for each'
            )
        return np.broadcast_to(np.array(values, np.float64), self._channels).reshape(-1, 1, 1)


def _weights_of(path: Path) -> Path:
    """Return the file beside a model in which PyTorch stores its weights."""
    return path.with_name(f'{path.name}.data')


def open_model(config: Config) -> OnnxModel | None:
    """Return the model that a configuration names by its path; None if it names none."""
    path = config.encoding.descriptor_model
    if not path or path.startswith('#'):
        return None
    return OnnxModel(Path(path), config.reading)


def _numbers(value: Any) -> tuple[float, ...]:
    """Return the numbers of a list, or of a text with commas, spaces or x between them."""
    parts = re.split('[,x ]+', value.strip(' []()')) if isinstance(value, str) else value
    numbers = tuple(map(float, parts if isinstance(parts, list) else [parts]))
    if not np.isfinite(numbers).all() or not numbers:
        raise ValueError(f'{value!r} is not a list of numbers')
    return numbers
