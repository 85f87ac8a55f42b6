"""EM iterations on a CUDA device as graphs: an iteration is two hundred small kernels, launched at once."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import torch
from torch import Tensor

__all__ = ["CapturedStep", "Stepper"]

Record = TypeVar("Record")
"""A dataclass of tensors and of such dataclasses."""

Step = Callable[[Any, Any], tuple[Any, Any]]

_kept = threading.local()


class Stepper:
    """Calls a step again and again: as it is the first time, and from then on as a graph where CUDA can.

    The first call makes what a graph must find: the handles of the libraries, and tensors that are kept.
    """

    def __init__(self, step: Step) -> None:
        self._step: Step = step
        self._called = False
        self._captured: CapturedStep | None = None
        self._possible = True

    def __call__(self, state: Record, statistics: Any) -> tuple[Record, Any]:
        """One step. What a graph returns lives in its memory: the next call overwrites it."""
        first, self._called = not self._called, True
        if first or not self._possible or not next(_leaves(state)).is_cuda:
            return self._step(state, statistics)
        if self._captured is None:
            try:
                self._captured = CapturedStep(self._step, state, statistics)
            except RuntimeError as failure:
                self._possible = False
                warnings.warn(
                    f"EM iterations are launched kernel by kernel, several times slower, since CUDA could not "
                    f"capture one as a graph: {failure}",
                    RuntimeWarning,
                    stacklevel=2,
                )
                return self._step(state, statistics)
        return self._captured(state, statistics)


class CapturedStep:
    """A step from two records to their successors as a CUDA graph; nothing in it may wait for the device."""

    def __init__(self, step: Step, state: Any, statistics: Any) -> None:
        self._held = _copied(state), _copied(statistics)
        self._device = next(_leaves(state)).device
        self._graph = torch.cuda.CUDAGraph()
        with torch.cuda.device(self._device):
            here, aside = torch.cuda.current_stream(), _stream_aside(self._device)
            aside.wait_stream(here)
            with torch.cuda.stream(aside):
                self._capture(step)
            here.wait_stream(aside)

    def _capture(self, step: Step) -> None:
        # Not torch.cuda.graph(...), which waits for the device and empties the allocator's cache every time.
        self._graph.capture_begin(capture_error_mode="thread_local")
        try:
            for held, made in zip(self._held, step(*self._held), strict=True):
                _overwrite(held, made)
        finally:
            self._graph.capture_end()

    def __call__(self, state: Any, statistics: Any) -> tuple[Any, Any]:
        """The step; what is returned is overwritten by the next call."""
        with torch.cuda.device(self._device):
            for held, given in zip(self._held, (state, statistics), strict=True):
                if held is not given:
                    _overwrite(held, given)
            self._graph.replay()
        return self._held


def _stream_aside(device: torch.device) -> torch.cuda.Stream:
    """The stream on which this thread captures: always the same, since the BLAS keeps a workspace for every stream."""
    streams: dict[torch.device, torch.cuda.Stream] = _kept.__dict__.setdefault("streams", {})
    if device not in streams:
        streams[device] = torch.cuda.Stream(device)
    return streams[device]


def _leaves(record: Any) -> Iterator[Tensor]:
    """The tensors of a record, depth first."""
    for field in fields(record):
        value = getattr(record, field.name)
        if is_dataclass(value):
            yield from _leaves(value)
        else:
            yield value


def _copied(record: Record) -> Record:
    """The record in memory of its own."""
    values = {field.name: getattr(record, field.name) for field in fields(record)}  # type: ignore[arg-type]
    copies = {k: _copied(v) if is_dataclass(v) else v.clone() for k, v in values.items()}
    return replace(record, **copies)  # type: ignore[type-var]


def _overwrite(record: Any, other: Any) -> None:
    """Copy the values of another record into this one's memory."""
    for mine, theirs in zip(_leaves(record), _leaves(other), strict=True):
        mine.copy_(theirs)
