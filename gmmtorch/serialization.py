"""Tensors in safetensors files, with the name of what they are: never pickle."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import safetensors
import safetensors.torch
from torch import Tensor

from gmmtorch.errors import SerializationError

__all__ = ["load", "save"]

_VERSION = "1"


def save(path: str | PathLike[str], kind: str, tensors: dict[str, Tensor]) -> None:
    """Write named tensors and their kind."""
    on_host = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    safetensors.torch.save_file(on_host, Path(path), metadata={"kind": kind, "version": _VERSION})


def load(path: str | PathLike[str], kind: str) -> dict[str, Tensor]:
    """Read the tensors of a file that `save` wrote with the same kind.

    Raises:
        SerializationError: if the file is missing, damaged, or of another kind or version.
    """
    try:
        with safetensors.safe_open(Path(path), framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
    except FileNotFoundError as error:
        raise SerializationError(f"{path} does not exist") from error
    except (OSError, safetensors.SafetensorError) as error:
        raise SerializationError(f"{path} is not a readable safetensors file: {error}") from error
    if metadata.get("kind") != kind or metadata.get("version") != _VERSION:
        raise SerializationError(
            f"{path} holds {metadata.get('kind', 'something unnamed')} version {metadata.get('version', '?')}, "
            f"expected {kind} version {_VERSION}; write it again with this version of gmmtorch"
        )
    return tensors
