"""EM of the peers from given starts: oneDAL, scikit-learn, and gmm-gpu, which needs an environment of its own."""

from __future__ import annotations

import os
import subprocess
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from benchmarks.engine.timing import timed
from gmmtorch import GaussianMixtures, PointClouds

GMM_GPU_PYTHON = Path(os.environ.get("GMM_GPU_PYTHON", ".venv-gmm-gpu/bin/python"))
"""It needs numpy < 2: `make bench-engine` puts it into an environment of its own."""


class OneDal:
    """oneDAL's EM of one cloud; `fitted` holds the result of the last call, `failed` counts those that raised."""

    def __init__(self, points: np.ndarray, start: GaussianMixtures, iterations: int, dtype: str) -> None:
        import daal4py

        count = int(start.num_components[0])
        self._values = np.ascontiguousarray(points, dtype=dtype)
        self._start = (
            start.weights[:1, :count].numpy().astype(dtype),
            start.means[0, :count].numpy().astype(dtype),
            [c.astype(dtype) for c in start.covariances[0, :count].numpy()],
        )
        self._algorithm = daal4py.em_gmm(
            nComponents=count, maxIterations=iterations, accuracyThreshold=0.0, covarianceStorage="full",
            regularizationFactor=0.0, fptype="double" if dtype == "float64" else "float",
        )  # fmt: skip
        self.fitted = None
        self.failed = 0

    def __call__(self) -> None:
        try:
            self.fitted = self._algorithm.compute(self._values, *self._start)
        except RuntimeError:  # an ill-conditioned covariance
            self.failed += 1

    def log_likelihood(self) -> float:
        """Total log-likelihood of the last result (nats), in float64."""
        weights, means = np.asarray(self.fitted.weights).ravel(), self.fitted.means
        mixture = GaussianMixtures.from_arrays(
            weights / weights.sum(), means, np.stack(self.fitted.covariances)
        )
        return float(mixture.log_prob(PointClouds.from_list([self._values])).sum())


def scikit_learn_em(points: np.ndarray, start: GaussianMixtures, iterations: int) -> float:
    """Seconds that scikit-learn takes for the same iterations, once."""
    from sklearn.mixture import GaussianMixture

    model = GaussianMixture(
        int(start.num_components[0]), max_iter=iterations, tol=0.0, reg_covar=0.0,
        weights_init=start.weights[0].numpy(), means_init=start.means[0].numpy(),
        precisions_init=torch.linalg.inv(start.covariances[0]).numpy(),
    )  # fmt: skip
    return timed(_without_warnings(lambda: model.fit(points)))


def gmm_gpu_em(points: np.ndarray, start: GaussianMixtures, iterations: int) -> float | None:
    """Seconds that gmm-gpu takes on the CPU in float32, k-means included, once; None where it is not installed."""
    if not GMM_GPU_PYTHON.exists():
        return None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "start.npz"
        precisions = torch.linalg.inv(start.covariances).numpy()
        np.savez(file, points=points, weights=start.weights, means=start.means, precisions=precisions)
        script = Path(__file__).with_name("run_gmm_gpu.py")
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        told = subprocess.run(
            [GMM_GPU_PYTHON, script, file, str(iterations)],
            capture_output=True, text=True, check=True, env=environment,
        )  # fmt: skip
    return float(told.stdout)


def _without_warnings(call: Callable[[], object]) -> Callable[[], object]:
    def quiet() -> object:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return call()

    return quiet
