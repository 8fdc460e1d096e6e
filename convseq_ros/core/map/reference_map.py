# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reference map: places in the order in which the robot passed them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from threading import Lock
from typing import Any
from uuid import uuid4

from convseq_ros.config import EncodingConfig, KeyframeConfig
from convseq_ros.core.encoding.descriptor import cell_shape, visible_cells
from convseq_ros.core.encoding.first_stage import vector_length
from convseq_ros.core.encoding.keypoints import BYTES, detect, StoredKeypoints
from convseq_ros.core.encoding.mask import without_path
from convseq_ros.core.encoding.regions import Cells, global_descriptor
from convseq_ros.core.graph.links import Links
from convseq_ros.core.graph.trail import Trail
from convseq_ros.core.map.arrays import Places
from convseq_ros.core.map.format import MapSession
from convseq_ros.core.map.image_coding import decode_image, encode_image, thumbnail
from convseq_ros.core.map.place import pack_cells, Packed, Picture, Place, unpack_cells
from convseq_ros.core.types import Camera, Descriptor, Frame, Gray, Halves, Pose
from convseq_ros.errors import MapError
import cv2
import numpy as np
import numpy.typing as npt

ReadPictures = Callable[[Sequence[int], bool], list[Picture]]


class ReferenceMap:
    """
    Places and their cells, by index.

    Cells are held in half precision, as in a file, so that a map gives the same answers before it
    is saved and after it is opened. Cells in a file are read on demand and not cached; MapError if
    they are damaged. One thread may add places while others read: a place gets its index when it
    is complete. A place takes 0.6 kB of memory, its link 0.4 kB, and 16 kB more until it is
    stored. `keyframes` is the spacing of places and of matched frames. `map_id` is a UUID, a new
    one unless the map is read from a file; `links` connect places that show the same scene. Images
    are read only if `keeps_images`; `unreadable` counts those that could not be decoded, and
    `unreadable_why` explains the last of them.
    """

    def __init__(
        self,
        encoding: EncodingConfig = EncodingConfig(),
        places: Places | None = None,
        read_pictures: ReadPictures | None = None,
        keyframes: KeyframeConfig = KeyframeConfig(),
        map_id: str = '',
        sessions: Sequence[MapSession] = (),
        links: Links | None = None,
        problem: str = '',
        keeps_images: bool = False,
        trail: Trail | None = None,
    ) -> None:
        self.position_sigma_m = 0.0  # standard deviation of its positions, if its maker tells it
        self.encoding, self.keyframes = without_path(encoding), keyframes
        self.map_id, self.sessions = map_id or str(uuid4()), [*sessions]
        self.cell_shape = cell_shape(encoding.image_size_px)
        self.places = Places(vector_length(encoding)) if places is None else places
        self.bounds = self.places.bounds  # where its sessions begin
        self._read_pictures, self._stored = read_pictures, len(self.places)
        self._in_memory: list[Picture] = []
        self._moving = Lock()
        self._usual_mount: Pose | None = None
        self.links = Links(self.bounds.around) if links is None else links
        self.trail = Trail() if trail is None else trail  # of its drives with odometry
        self.problem = problem  # one line about damage that does not prevent the use of the map
        self.keeps_images = keeps_images  # whether there may be images
        self.unreadable, self.unreadable_why = 0, ''
        # The newest image whose keypoints were detected, how many at most, and these.
        self._detected: tuple[Gray, int, StoredKeypoints] | None = None

    def __len__(self) -> int:
        return len(self.places)

    @property
    def session_ranges(self) -> list[range]:
        """The places of each session that has some, in order."""
        edges = pairwise([*self.bounds.starts.tolist(), len(self)])
        return [range(start, end) for start, end in edges if start < end]

    @property
    def is_linked(self) -> bool:
        """Whether every place was looked up among the earlier ones."""
        return self.links.looked_up_count >= len(self)

    @property
    def global_descriptors(self) -> Halves:
        """The global descriptors of all places, (R, n); do not write to them."""
        return self.places.descriptors.view

    def add_frame(
        self,
        frame: Frame,
        descriptor: Descriptor,
        thumbnail_width_px: int = 0,
        keep_images_px: int = 0,
        keypoints: int = 0,
        small: bytes = b'',
    ) -> None:
        """
        Append a place made from a frame and its descriptor, with at most so many keypoints.

        `small` is the thumbnail of a frame without an image, whose keypoints its descriptor has.
        """
        if not self.sessions:
            self.begin_session(frame.stamp_ns, frame.camera)
        place = Place(frame.stamp_ns, frame.source, frame.pose, len(self.sessions) - 1)
        image = None
        corners = b'' if descriptor.keypoints is None else descriptor.keypoints.tobytes()
        if (gray := frame.gray) is not None:
            small, image = thumbnail(gray, thumbnail_width_px), encode_image(gray, keep_images_px)
            corners = self.detect(gray, keypoints).tobytes()
        packed = pack_cells(descriptor.cells)
        self.add(place, packed, small, descriptor.vector, image, corners)

    def add(
        self,
        place: Place,
        packed: Halves,
        thumbnail: bytes = b'',
        descriptor: npt.ArrayLike | None = None,
        image: bytes | None = None,
        keypoints: bytes = b'',
    ) -> None:
        """Append a place; its global descriptor (n,) is computed from the cells by default."""
        shape, dtype = packed.shape, packed.dtype
        if shape != self.cell_shape or dtype != np.float16:
            raise ValueError(f'expected {self.cell_shape} float16, got {shape} {dtype}')
        if descriptor is None:
            if self.encoding.descriptor_model:
                raise ValueError('expected the vector of the place, got None')
            descriptor = global_descriptor(unpack_cells(packed))
        if not self.sessions:
            self.begin_session(place.stamp_ns)
        self.keeps_images |= image is not None
        self._in_memory.append(Picture(packed, thumbnail, keypoints, image))
        self.places.append(place, descriptor)

    def begin_session(
        self, start_ns: int, camera: Camera | None = None, name: str = '', frame: str | None = None
    ) -> None:
        """Begin a session, to which the places added from now on belong."""
        self.sessions.append(MapSession(str(uuid4()), name, start_ns, camera, frame))

    def assume_mount(self, mount: Pose) -> None:
        """Set the mount of the camera in sessions that have none; by default the query's."""
        self._usual_mount = mount

    def take_links(self) -> Links:
        """Remove all links, and return them."""
        taken, self.links = self.links, Links(self.bounds.around)
        return taken

    def camera_of(self, index: int, query: Camera) -> Camera:
        """Return the camera of a place; what its session lacks comes from the query's camera."""
        camera = self.sessions[self.places[index].session].camera
        mount = (camera and camera.mount) or self._usual_mount or query.mount
        return replace(camera or query, mount=mount)

    def packed(self, index: int) -> Halves:
        """Return the packed cells of a place."""
        return self.pictures([index])[0].packed

    def cells(self, index: int) -> Cells:
        """Return the cells of a place, float32 of shape `cell_shape`."""
        return unpack_cells(self.packed(index))

    def packed_of(self, indices: Sequence[int]) -> list[Packed]:
        """Return the packed cells of several places, read together."""
        return [picture.packed for picture in self.pictures(indices)]

    def thumbnail(self, index: int) -> bytes:
        """Return the thumbnail of a place, a JPEG; empty if it has none."""
        return self.pictures([index])[0].thumbnail

    def pictures(self, indices: Sequence[int], with_images: bool = False) -> list[Picture]:
        """Return the pictures of places; those in the file are read together."""
        count, indices = len(self), [int(index) for index in indices]  # SQLite refuses NumPy's
        for index in indices:
            if not 0 <= index < count:
                raise IndexError(f'reference {index} of {count}')
        with self._moving:
            stored, read = self._stored, self._read_pictures
            pictures = {at: self._in_memory[at - stored] for at in indices if at >= stored}
        missing = [index for index in indices if index not in pictures]
        if read and missing:
            pictures.update(zip(missing, read(missing, with_images), strict=True))
        return [pictures[index] for index in indices]

    def image(self, index: int, max_mpx: float) -> Gray | None:
        """Return the image of a place; None if none was kept, or it cannot be decoded."""
        return self._decoded('image', index, lambda kept: decode_image(kept.image, max_mpx))

    def detect(self, gray: Gray, most: int) -> StoredKeypoints:
        """Return the keypoints (n, 34) of an upright image (H, W), without masked parts."""
        if self._detected is None or self._detected[0] is not gray or self._detected[1] != most:
            visible = visible_cells(self.encoding.image_mask, self.cell_shape[0])
            self._detected = gray, most, detect(gray, visible, most)
        return self._detected[2]

    def keypoints(self, index: int) -> StoredKeypoints | None:
        """Return the keypoints (n, 34) of a place; None if none were kept, or they are damaged."""

        def decode(kept: Picture) -> StoredKeypoints | None:
            stored = np.frombuffer(kept.keypoints, np.uint8).reshape(-1, BYTES)
            return stored if len(stored) else None

        return self._decoded('keypoints', index, decode, with_images=False)

    def _decoded(
        self, what: str, index: int, decode: Callable[[Picture], Any], with_images: bool = True
    ) -> Any:
        if with_images and not self.keeps_images:
            return None
        try:
            return decode(*self.pictures([index], with_images))
        except (MapError, ValueError, cv2.error) as error:
            self.unreadable += 1
            self.unreadable_why = f'kept {what} of reference {index}: {error}'
            return None

    def evict(self, count: int, read_pictures: ReadPictures) -> None:
        """Release the pictures of the first `count` places, which `read_pictures` can read now."""
        with self._moving:
            del self._in_memory[: max(0, count - self._stored)]
            self._stored, self._read_pictures = count, read_pictures
