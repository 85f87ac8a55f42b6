"""A batch of Gaussian mixtures: evaluation, sampling, storage."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike

import torch
from torch import Tensor

from gmmtorch import linalg, serialization
from gmmtorch.clouds import ArrayLike, PointClouds
from gmmtorch.errors import ArgumentError, SerializationError, ShapeError
from gmmtorch.evaluation import Densities, Posterior

__all__ = ["GaussianMixtures"]

_FORMAT = "gmmtorch.GaussianMixtures"


@dataclass(frozen=True, eq=False)
class GaussianMixtures:
    """B mixtures of at most K Gaussians each, always in float64 and in the caller's units.

    Components k >= num_components[b] are padding: weight 0, mean 0, covariance I.

    Attributes:
        weights: pi_k (B, K), summing to 1 over the components of a mixture.
        means: mu_k (B, K, D), m.
        covariances: S_k (B, K, D, D), m^2.
        num_components: components of every mixture (B,) int64; 0 for a mixture that could not be fitted.
    """

    weights: Tensor
    means: Tensor
    covariances: Tensor
    num_components: Tensor

    @staticmethod
    def from_arrays(
        weights: ArrayLike,
        means: ArrayLike,
        covariances: ArrayLike,
        num_components: ArrayLike | None = None,
    ) -> GaussianMixtures:
        """Build and check mixtures; arrays without the batch axis make a batch of one.

        Args:
            weights: (B, K) or (K,), >= 0; scaled to sum to 1.
            means: (B, K, D) or (K, D), m.
            covariances: (B, K, D, D) or (K, D, D), symmetric positive definite, m^2.
            num_components: (B,); by default every component of positive weight, which must come first.

        Raises:
            ShapeError: if the shapes do not fit.
            ArgumentError: if a weight is negative or a covariance is not positive definite.
        """
        w, m, c = (torch.as_tensor(v).detach().to(torch.float64) for v in (weights, means, covariances))
        if w.ndim == 1:
            w, m, c = w[None], m[None], c[None]
        if w.ndim != 2 or m.shape[:2] != w.shape or m.ndim != 3 or c.shape != (*m.shape, m.shape[-1]):
            raise ShapeError(
                "expected weights (B, K), means (B, K, D), covariances (B, K, D, D), got "
                f"{tuple(w.shape)}, {tuple(m.shape)}, {tuple(c.shape)}"
            )
        if not bool((w >= 0).all()):
            raise ArgumentError("weights must be >= 0 and finite")
        present = torch.arange(w.shape[1], device=w.device)
        count = (w > 0).sum(1) if num_components is None else torch.as_tensor(num_components).to(w.device)
        mask = present < count[:, None]
        if bool((mask != (w > 0)).any()):
            raise ArgumentError(
                "the components of positive weight must be the first num_components of each mixture"
            )
        if not bool((linalg.safe_cholesky(c)[1] | ~mask).all()):
            raise ArgumentError("a covariance is not positive definite; add a small multiple of the identity")
        return _with_padding(_scaled_to_one(w), m, c, count)

    @staticmethod
    def from_list(mixtures: Sequence[GaussianMixtures]) -> GaussianMixtures:
        """Concatenate batches along B, padded to their largest K.

        Raises:
            ShapeError: if the list is empty or the dimensions differ.
        """
        if len(mixtures) == 0:
            raise ShapeError("expected at least one batch of mixtures, got an empty list")
        dims = {m.dim for m in mixtures}
        if len(dims) > 1:
            raise ShapeError(f"mixtures of one batch need the same number of coordinates, got {sorted(dims)}")
        slots = max(m.num_slots for m in mixtures)
        padded = [m.pad(slots) for m in mixtures]
        return GaussianMixtures(
            weights=torch.cat([m.weights for m in padded]),
            means=torch.cat([m.means for m in padded]),
            covariances=torch.cat([m.covariances for m in padded]),
            num_components=torch.cat([m.num_components for m in padded]),
        )

    @property
    def batch_size(self) -> int:
        """Number of mixtures B."""
        return self.weights.shape[0]

    @property
    def num_slots(self) -> int:
        """Common length K of the component axis, padding included."""
        return self.weights.shape[1]

    @property
    def dim(self) -> int:
        """Number of coordinates D."""
        return self.means.shape[-1]

    @property
    def mask(self) -> Tensor:
        """Whether a component is there, not padding (B, K) bool."""
        return torch.arange(self.num_slots, device=self.weights.device) < self.num_components[:, None]

    def __len__(self) -> int:
        """Number of mixtures B."""
        return self.batch_size

    def __getitem__(self, index: int) -> GaussianMixtures:
        """Return mixture `index` as a batch of one."""
        return self.select([index])

    def __iter__(self) -> Iterator[GaussianMixtures]:
        """Iterate over batches of one."""
        return (self[b] for b in range(self.batch_size))

    def select(self, indices: Sequence[int]) -> GaussianMixtures:
        """Return the mixtures of these indices, in this order; an index may repeat."""
        rows = torch.tensor([range(self.batch_size)[i] for i in indices], dtype=torch.int64).to(
            self.weights.device
        )
        return GaussianMixtures(
            self.weights[rows], self.means[rows], self.covariances[rows], self.num_components[rows]
        )

    def pad(self, num_slots: int) -> GaussianMixtures:
        """Lengthen the component axis to `num_slots` with padding."""
        extra = num_slots - self.num_slots
        if extra < 0:
            raise ArgumentError(
                f"cannot pad {self.num_slots} component slots down to {num_slots}; use trim()"
            )
        return _with_padding(
            torch.nn.functional.pad(self.weights, (0, extra)),
            torch.nn.functional.pad(self.means, (0, 0, 0, extra)),
            torch.nn.functional.pad(self.covariances, (0, 0, 0, 0, 0, extra)),
            self.num_components,
        )

    def trim(self) -> GaussianMixtures:
        """Shorten the component axis to the largest mixture; synchronises the device."""
        slots = max(1, int(self.num_components.max()))
        return GaussianMixtures(
            self.weights[:, :slots], self.means[:, :slots], self.covariances[:, :slots], self.num_components
        )

    def to(self, device: torch.device | str) -> GaussianMixtures:
        """Return the mixtures on another device."""
        return GaussianMixtures(*(t.to(device) for t in self._tensors()))

    def log_prob(self, clouds: PointClouds) -> Tensor:
        """Log p(x_n) under the mixture of the point's cloud (N,), nats; -inf where the mixture is empty.

        For cells, the bound per unit weight logsumexp_k(eta_k mean(phi)). Equals
        `sklearn.mixture.GaussianMixture.score_samples` for points.
        """
        return self._densities(clouds).log_prob(clouds)

    def responsibilities(self, clouds: PointClouds) -> Tensor:
        """r_nk, the posterior of every component (N, K); rows sum to 1, or are 0 where the mixture is empty."""
        return self._densities(clouds).responsibilities(clouds)

    def assign(self, clouds: PointClouds) -> Tensor:
        """argmax_k r_nk (N,) int64; -1 where the mixture is empty."""
        return self._densities(clouds).components(clouds)

    def posterior(self, clouds: PointClouds) -> Posterior:
        """`log_prob`, `responsibilities` and `assign` at once, in little more than the time of one of them."""
        return self._densities(clouds).posterior(clouds)

    def expected_counts(self, clouds: PointClouds) -> Tensor:
        """Expected number of points of every component, sum_n w_n r_nk (B, K), without keeping the r_nk."""
        return self._densities(clouds).expected_counts(clouds)

    def sample(self, num_samples: int | Sequence[int], seed: int = 0) -> PointClouds:
        """Draw points from every mixture; see `sample_components` for where each came from."""
        return self.sample_components(num_samples, seed)[0]

    def sample_components(
        self, num_samples: int | Sequence[int], seed: int = 0
    ) -> tuple[PointClouds, Tensor]:
        """Draw points from every mixture, and the component that each came from; synchronises.

        Args:
            num_samples: points per mixture, one number or B; an empty mixture gives none.
            seed: the same seed gives every mixture the same stream, wherever it stands in the batch.

        Returns:
            The clouds, and the component of every point (N,) int64.
        """
        sizes = [num_samples] * self.batch_size if isinstance(num_samples, int) else list(num_samples)
        if len(sizes) != self.batch_size or min(sizes) < 0:
            raise ArgumentError(
                f"num_samples must be >= 0, one number or {self.batch_size}, got {num_samples}"
            )
        drawn = [_sample_one(self[b], n, seed) for b, n in enumerate(sizes)]
        return PointClouds.from_list([x for x, _ in drawn]), torch.cat([k for _, k in drawn])

    def save(self, path: str | PathLike[str]) -> None:
        """Write a safetensors file."""
        names = ("weights", "means", "covariances", "num_components")
        serialization.save(path, _FORMAT, dict(zip(names, self._tensors(), strict=True)))

    @staticmethod
    def load(path: str | PathLike[str]) -> GaussianMixtures:
        """Read a file that `save` wrote.

        Raises:
            SerializationError: if the file is missing, damaged, or of another kind.
        """
        tensors = serialization.load(path, _FORMAT)
        try:
            return GaussianMixtures.from_arrays(**tensors)
        except (TypeError, ArgumentError, ShapeError) as error:
            raise SerializationError(f"{path} does not hold valid mixtures: {error}") from error

    def _tensors(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        return self.weights, self.means, self.covariances, self.num_components

    def _densities(self, clouds: PointClouds) -> Densities:
        """The mixtures prepared for these clouds, checked to fit them."""
        if clouds.batch_size != self.batch_size or clouds.dim != self.dim:
            raise ShapeError(
                f"expected {self.batch_size} clouds of {self.dim} coordinates, one per mixture, got "
                f"{clouds.batch_size} of {clouds.dim}; use select() to pair them"
            )
        return Densities.of(self.weights, self.means, self.covariances)


def _sample_one(mixture: GaussianMixtures, num_samples: int, seed: int) -> tuple[Tensor, Tensor]:
    """Points (N, D) and components (N,) of a batch of one."""
    count = int(mixture.num_components[0])
    device = mixture.means.device
    if count == 0:
        return mixture.means.new_zeros(0, mixture.dim), torch.zeros(0, dtype=torch.int64, device=device)
    generator = torch.Generator().manual_seed(seed)
    uniform = torch.rand(num_samples, dtype=torch.float64, generator=generator).to(device)
    normal = torch.randn(num_samples, mixture.dim, dtype=torch.float64, generator=generator).to(device)
    bounds = mixture.weights[0, :count].cumsum(0)
    component = torch.searchsorted(bounds, uniform * bounds[-1], right=True).clamp_max(count - 1)
    factors, _ = linalg.safe_cholesky(mixture.covariances[0])
    points = mixture.means[0][component] + (factors[component] @ normal[..., None]).squeeze(-1)
    return points, component


def _scaled_to_one(weights: Tensor) -> Tensor:
    """Weights (B, K) >= 0 divided by their sum; those whose sum is 1 but for rounding keep every bit."""
    total = weights.sum(1, keepdim=True)
    exact = (total - 1.0).abs() <= weights.shape[1] * torch.finfo(weights.dtype).eps
    return weights / torch.where(exact | (total == 0), 1.0, total)


def _with_padding(weights: Tensor, means: Tensor, covariances: Tensor, count: Tensor) -> GaussianMixtures:
    """Set the slots from `count` on to weight 0, mean 0, covariance I."""
    mask = torch.arange(weights.shape[1], device=weights.device) < count[:, None]
    identity = torch.eye(means.shape[-1], dtype=means.dtype, device=means.device)
    return GaussianMixtures(
        weights=torch.where(mask, weights, 0.0),
        means=torch.where(mask[..., None], means, 0.0),
        covariances=torch.where(mask[..., None, None], covariances, identity),
        num_components=count.to(torch.int64),
    )
