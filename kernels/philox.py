"""Counter-based random numbers: Philox4x32-10 (Salmon, Moraes, Dror & Shaw, SC 2011).

Key (seed, body kind) and counter (body, step, stream, block) name every draw, so a body's path depends neither on how
many bodies there are nor on how the launch is cut up, and nothing has to be stored between steps.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Streams: what a draw is for. The fourth counter word.
STREAM_SEEN_WIND = wp.constant(wp.uint32(0))
STREAM_INITIAL_WIND = wp.constant(wp.uint32(1))
STREAM_EMITTER = wp.constant(wp.uint32(2))
STREAM_SEEN_ROTATION = wp.constant(wp.uint32(3))
STREAM_INITIAL_ROTATION = wp.constant(wp.uint32(4))
STREAM_TUMBLING_AXIS = wp.constant(wp.uint32(5))

MULTIPLIER_0 = wp.constant(wp.uint64(0xD2511F53))
MULTIPLIER_1 = wp.constant(wp.uint64(0xCD9E8D57))
WEYL_0 = wp.constant(wp.uint32(0x9E3779B9))
WEYL_1 = wp.constant(wp.uint32(0xBB67AE85))

# The sum of four bytes has mean 510 and variance 4 (256^2 - 1) / 12.
BYTE_SUM_MEAN = wp.constant(510)
BYTE_SUM_SCALE = wp.constant(0.006765840293)


@wp.func
def philox(
    counter_0: wp.uint32,
    counter_1: wp.uint32,
    counter_2: wp.uint32,
    counter_3: wp.uint32,
    key_0: wp.uint32,
    key_1: wp.uint32,
):
    """Four random 32-bit words from a counter and a key."""
    c0 = counter_0
    c1 = counter_1
    c2 = counter_2
    c3 = counter_3
    k0 = key_0
    k1 = key_1
    for _ in range(10):
        product_0 = MULTIPLIER_0 * wp.uint64(c0)
        product_1 = MULTIPLIER_1 * wp.uint64(c2)
        n0 = wp.uint32(product_1 >> wp.uint64(32)) ^ c1 ^ k0
        n2 = wp.uint32(product_0 >> wp.uint64(32)) ^ c3 ^ k1
        c1 = wp.uint32(product_1)
        c3 = wp.uint32(product_0)
        c0 = n0
        c2 = n2
        k0 = k0 + WEYL_0
        k1 = k1 + WEYL_1
    return c0, c1, c2, c3


@wp.func
def byte_sum_normal(word: wp.uint32):
    """A variate of mean 0 and variance 1 from one word: the sum of its four bytes (excess kurtosis -0.3).

    Enough for the increments of an Ornstein-Uhlenbeck process, which sums many of them.
    """
    pairs = (word & wp.uint32(0x00FF00FF)) + ((word >> wp.uint32(8)) & wp.uint32(0x00FF00FF))
    total = wp.int32((pairs & wp.uint32(0xFFFF)) + (pairs >> wp.uint32(16)))
    return wp.float32(total - BYTE_SUM_MEAN) * BYTE_SUM_SCALE


@wp.func
def open_unit(word: wp.uint32):
    """A uniform variate in the open interval (0, 1) from one word."""
    return (wp.float32(word >> wp.uint32(8)) + 0.5) * (1.0 / 16777216.0)


@wp.func
def byte_sum_normals(body: wp.int32, step: wp.int32, stream: wp.uint32, seed: wp.uint32, kind_key: wp.uint32):
    """Three independent byte-sum variates (vec3) for one body and step."""
    a, b, c, _ = philox(wp.uint32(body), wp.uint32(step), stream, wp.uint32(0), seed, kind_key)
    return wp.vec3(byte_sum_normal(a), byte_sum_normal(b), byte_sum_normal(c))


@wp.func
def gaussian_normals(body: wp.int32, step: wp.int32, stream: wp.uint32, seed: wp.uint32, kind_key: wp.uint32):
    """Three independent Gaussian variates (vec3) for one body and step (Box-Muller)."""
    a, b, c, d = philox(wp.uint32(body), wp.uint32(step), stream, wp.uint32(0), seed, kind_key)
    radius = wp.sqrt(-2.0 * wp.log(open_unit(a)))
    angle = 6.2831853 * open_unit(b)
    other = wp.sqrt(-2.0 * wp.log(open_unit(c))) * wp.cos(6.2831853 * open_unit(d))
    return wp.vec3(radius * wp.cos(angle), radius * wp.sin(angle), other)


@wp.kernel
def random_words(
    first_body: wp.int32,
    step: wp.uint32,
    stream: wp.uint32,
    block: wp.uint32,
    key_0: wp.uint32,
    key_1: wp.uint32,
    words_out: wp.array2d(dtype=wp.uint32),
):
    """words_out (N, 4): the block of random words of bodies first_body ... first_body + N - 1."""
    i = wp.tid()
    a, b, c, d = philox(wp.uint32(first_body + i), step, stream, block, key_0, key_1)
    words_out[i, 0] = a
    words_out[i, 1] = b
    words_out[i, 2] = c
    words_out[i, 3] = d


@wp.kernel
def normal_variates(
    gaussian: wp.bool,
    step: wp.int32,
    seed: wp.uint32,
    kind_key: wp.uint32,
    variates_out: wp.array(dtype=wp.vec3),
):
    """variates_out (N,): the three normal variates of body i at one step, for tests of their distribution."""
    i = wp.tid()
    if gaussian:
        variates_out[i] = gaussian_normals(i, step, STREAM_INITIAL_WIND, seed, kind_key)
    else:
        variates_out[i] = byte_sum_normals(i, step, STREAM_SEEN_WIND, seed, kind_key)
