"""Philox4x32-10 against its published vectors, and the variates made from it."""

import numpy as np
import pytest
import warp as wp

from warp_immersed.counter_random import random_key, uniforms
from warp_immersed.kernels.philox import normal_variates, random_words

# counter, key, words: kat_vectors of Random123 (Salmon et al., SC 2011)
KNOWN_ANSWERS = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@pytest.mark.parametrize(("counter", "key", "expected"), KNOWN_ANSWERS)
def test_known_answers(counter, key, expected) -> None:
    words = wp.empty((1, 4), dtype=wp.uint32, device="cpu")
    first = np.uint32(counter[0]).astype(np.int32)
    wp.launch(random_words, 1, inputs=[int(first), *counter[1:], *key], outputs=[words], device="cpu")
    assert tuple(words.numpy()[0]) == expected


@pytest.mark.parametrize("gaussian", [False, True])
def test_normal_variates_have_their_moments(gaussian: bool) -> None:
    count = 400_000
    out = wp.empty(count, dtype=wp.vec3, device="cpu")
    wp.launch(normal_variates, count, inputs=[gaussian, 5, 7, 11], outputs=[out], device="cpu")
    x = out.numpy().astype(np.float64)
    error = 1.0 / np.sqrt(x.size)
    kurtosis = 3.0 if gaussian else 3.0 - 0.3  # four summed bytes: -1.2 (1 - 1/256^2...) / 4
    assert abs(x.mean()) < 4.0 * error
    assert abs(x.var() - 1.0) < 4.0 * np.sqrt(kurtosis - 1.0) * error
    assert abs((x**3).mean()) < 4.0 * np.sqrt(15.0) * error
    assert abs((x**4).mean() - kurtosis) < 4.0 * np.sqrt(96.0) * error
    correlation = np.corrcoef(x.T)
    assert np.abs(correlation - np.eye(3)).max() < 5.0 / np.sqrt(count)


def test_draws_differ_between_bodies_steps_streams_seeds_and_kinds() -> None:
    base = uniforms(50, seed=1, key=2, stream=2, block=0)
    for other in (
        uniforms(50, seed=2, key=2, stream=2, block=0),
        uniforms(50, seed=1, key=3, stream=2, block=0),
        uniforms(50, seed=1, key=2, stream=1, block=0),
        uniforms(50, seed=1, key=2, stream=2, block=1),
    ):
        assert not np.intersect1d(base, other).size
    assert len(np.unique(base)) == base.size


def test_a_body_draws_the_same_however_many_there_are() -> None:
    assert np.array_equal(uniforms(10, 1, 2, 2, 0), uniforms(10_000, 1, 2, 2, 0)[:10])


def test_no_body_replays_another_later() -> None:
    """A generator seeded with (step + body) would: body j repeating body i some steps behind."""
    count, steps = 500, 40
    seen = {}
    for step in range(steps):
        words = wp.empty((count, 4), dtype=wp.uint32, device="cpu")
        wp.launch(random_words, count, inputs=[0, step, 0, 0, 3, 4], outputs=[words], device="cpu")
        for body, word in enumerate(map(tuple, words.numpy().tolist())):
            assert word not in seen, f"body {body} at step {step} repeats {seen[word]}"
            seen[word] = (body, step)


def test_keys_differ_between_kinds() -> None:
    assert random_key("maple") != random_key("oak")
