"""Run by the interpreter that has gmm-gpu: the seconds of its EM on the CPU from a stored start, printed.

In float32, since its k-means, which it runs even where means are given, fails in float64.
"""

import sys
import time

import numpy as np
import torch
from gmm_gpu.gmm import GMM

stored = {name: torch.from_numpy(values).float() for name, values in np.load(sys.argv[1]).items()}
model = GMM(
    stored["means"].shape[1], max_iter=int(sys.argv[2]), device="cpu", tol=0.0, dtype=torch.float32,
    means_init=stored["means"], weights_init=stored["weights"], precisions_init=stored["precisions"],
)  # fmt: skip
start = time.perf_counter()
model.fit(stored["points"][None])
print(time.perf_counter() - start)
