# Copyright 2026 The convseq_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Print the cost of an image in a batch, for the models of make_onnx_model.py.

Usage: python scripts/batches.py, one minute. `ms` is the median CPU time per image on one thread.
`same` says whether each vector is bit-identical to that of the image alone.
"""

import time

from drives import head, row
from make_onnx_model import make_model
import numpy as np
import onnxruntime

MODELS = ('hog', 96), ('random', 96), ('random', 224)  # kind, and the side of its input in px
BATCHES, MOST, ROUNDS = (1, 2, 4, 8), 8, 60


def session(kind: str, size: int) -> onnxruntime.InferenceSession:
    """Return an inference session of a model."""
    model = make_model(kind, size)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    providers = ['CPUExecutionProvider']
    return onnxruntime.InferenceSession(model.SerializeToString(), options, providers=providers)


def main() -> None:
    """Measure, and print a table."""
    head('model', 'side, px', 'batch', 'ms', 'same')
    for kind, size in MODELS:
        model = session(kind, size)
        shape = MOST, model.get_inputs()[0].shape[1], size, size
        images = np.random.default_rng(0).normal(size=shape).astype(np.float32)
        alone = [model.run(None, {'image': images[[at]]})[0][0] for at in range(MOST)]
        for count in BATCHES:
            took_ms = []
            for _ in range(ROUNDS):
                started = time.process_time()
                vectors = model.run(None, {'image': images[:count]})[0]
                took_ms.append((time.process_time() - started) * 1e3 / count)
            same = np.array_equal(vectors, alone[:count])
            row(kind, size, count, f'{np.median(took_ms):.2f}', same)


if __name__ == '__main__':
    main()
