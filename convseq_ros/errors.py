# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exceptions that this package raises on purpose: one clear line each."""


class ConvseqError(Exception):
    """Base of all; commands print it as one line and exit with 1."""


class ConfigError(ConvseqError):
    """A parameter is unknown, of the wrong type or out of bounds."""


class ImageError(ConvseqError):
    """A single image cannot be decoded; the stream that it came from goes on."""


class SourceError(ConvseqError):
    """A folder or recording cannot be read, or holds no images."""


class MapError(ConvseqError):
    """A reference map is missing, foreign, damaged or made with other settings."""


class ModelError(ConvseqError):
    """A descriptor model cannot be used, or failed on an image."""


class FleetError(ConvseqError):
    """A cluster cannot be reached, must not be, or none of its maps can be opened."""
