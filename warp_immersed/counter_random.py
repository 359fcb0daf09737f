"""Uniform random numbers on the host, from the device's counter-based generator."""

import zlib

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warp_immersed.kernels.philox import random_words


def random_key(name: str) -> int:
    """The 32-bit key of a body kind: it depends on nothing but the kind's name."""
    return zlib.crc32(name.encode())


def uniforms(count: int, seed: int, key: int, stream: int, block: int) -> NDArray[np.float64]:
    """Four uniform variates in (0, 1) for each of bodies 0 ... count - 1: (count, 4).

    They depend on (seed, key, stream, block) and the body alone. Always drawn on the CPU, so that every device starts
    from the same state.
    """
    words = wp.empty((count, 4), dtype=wp.uint32, device="cpu")
    wp.launch(random_words, dim=count, inputs=[0, 0, stream, block, seed, key], outputs=[words], device="cpu")
    return (words.numpy() + 0.5) / 2.0**32
