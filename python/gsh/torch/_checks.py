# SPDX-License-Identifier: Apache-2.0
"""Checks of what users pass: errors name the argument, what was found and what was expected."""

import torch


def check_tensor(where, name, value, shape, dtype=None):
    """Raises unless ``value`` is a dense CPU tensor of this shape and of ``dtype`` (None: float32 or float64).

    ``shape`` is a tuple of sizes; None stands for any size.
    """
    if not isinstance(value, torch.Tensor):
        raise TypeError(f"{where}: {name} is {type(value).__name__}, expected a torch.Tensor")
    if value.device.type != "cpu":
        raise ValueError(f"{where}: {name} is on {value.device}, expected a tensor on the CPU; call .cpu()")
    if value.layout != torch.strided:
        raise ValueError(f"{where}: {name} is {value.layout}, expected a dense tensor")
    if dtype is None and value.dtype not in (torch.float32, torch.float64):
        raise TypeError(f"{where}: {name} is {value.dtype}, expected torch.float32 or torch.float64")
    if dtype is not None and value.dtype != dtype:
        raise TypeError(f"{where}: {name} is {value.dtype}, expected {dtype} as the other arguments")
    if value.dim() != len(shape) or any(n is not None and n != m for n, m in zip(shape, value.shape)):
        expected = ", ".join("*" if n is None else str(n) for n in shape)
        raise ValueError(f"{where}: {name} has the shape {list(value.shape)}, expected [{expected}]")


def check_finite(where, **tensors):
    """Raises if a tensor, of those that are not None, holds a NaN or an infinity; names the first."""
    for name, tensor in tensors.items():
        if tensor is None:
            continue
        bad = ~torch.isfinite(tensor.detach())
        if bool(bad.any()):
            index = bad.nonzero()[0].tolist()
            raise ValueError(f"{where}: {name}{index} is {tensor.detach()[tuple(index)].item()}, "
                             "expected a finite number")


def explain(where, error, quats=None, **tensors):
    """Raises the error of the library again, naming the argument if a number in it is the reason."""
    check_finite(where, quats=quats, **tensors)
    if quats is not None:
        zero = (quats.detach() == 0).all(dim=-1)
        if bool(zero.any()):
            raise ValueError(f"{where}: quats{zero.nonzero()[0].tolist()} is zero, expected a rotation") from None
    raise ValueError(f"{where}: {error}") from None


def check_size(where, width, height):
    for name, value in (("width", width), ("height", height)):
        if isinstance(value, bool) or not hasattr(value, "__index__"):
            raise TypeError(f"{where}: {name} is {type(value).__name__}, expected a whole number")
        if not 1 <= value.__index__() <= 1048560:
            raise ValueError(f"{where}: {name} is {value.__index__()}, expected 1 to 1048560 pixels")


def check_choice(where, name, value, choices):
    if value not in choices:
        raise ValueError(f"{where}: {name} is {value!r}, expected one of {', '.join(map(repr, choices))}")


def refuse(where, condition, what):
    if condition:
        raise NotImplementedError(f"{where}: {what}")
