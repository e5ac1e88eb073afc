"""Pictures of the adapter: `python3 -m unittest` in this folder. Needs numpy, not gymnasium."""

import struct
import unittest
import zlib

import carl_env
import numpy as np


class Environment:
    """What the adapter asks of an environment."""

    class spec:
        max_episode_steps = 40

    class action_space:
        low, high, shape, dtype = np.array([-1.0, 0.0]), np.array([1.0, 2.0]), (2,), np.float32

    def __init__(self, **options):
        self.options, self.unwrapped, self.steps, self.closed = options, self, 0, False

    def reset(self, seed=None):
        self.steps, self.seed = 0, seed
        return None, {}

    def step(self, action):
        self.steps += 1
        return None, 0.0, self.steps == 3, False, {}

    def render(self):
        return np.full((6, 8, 3), 10 * self.steps, dtype=np.uint8)

    def close(self):
        self.closed = True


def served(options=None, **settings):
    return carl_env.Gymnasium(Environment, {"goal": lambda env: env.render(), **settings}, options or {})


def weights(n, size):
    """How much of each of n pixels lies in each of `size` parts, in parts of a pixel."""
    return np.array([[max(0, min((i + 1) * n, (j + 1) * size) - max(i * n, j * size)) for j in range(n)] for i in range(size)])


def png(picture, colour, methods):
    """A PNG file whose rows are filtered by these methods."""
    height, width = picture.shape[:2]
    rows, channels, packed = picture.reshape(height, -1).astype(int), picture.size // height // width, b""
    above = np.zeros(rows.shape[1], dtype=int)
    for row, method in zip(rows, methods):
        left = np.concatenate([np.zeros(channels, int), row[:-channels]])
        corner = np.concatenate([np.zeros(channels, int), above[:-channels]])
        guess = left + above - corner
        distances = np.abs(guess - np.array([left, above, corner]))
        paeth = np.choose(distances.argmin(axis=0), [left, above, corner])
        packed += bytes([method]) + ((row - [0 * row, left, above, (left + above) // 2, paeth][method]) % 256).astype(np.uint8).tobytes()
        above = row
    chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    head = struct.pack(">IIBBBBB", width, height, 8, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(packed)) + chunk(b"IEND", b"")


class Adapter(unittest.TestCase):
    def test_scaling_is_exact(self):
        rng = np.random.default_rng(0)
        for (rows, columns), (height, width) in [((50, 37), (8, 9)), ((7, 5), (3, 4)), ((4, 4), (8, 8)), ((6, 6), (6, 6))]:
            picture = rng.integers(0, 256, (rows, columns, 3), dtype=np.uint8)
            got = carl_env.summed(carl_env.summed(picture, height, 0), width, 1)
            want = np.einsum("ih,hwc,jw->ijc", weights(rows, height), picture.astype(int), weights(columns, width))
            self.assertTrue((got == want).all())

    def test_png_files_are_read_by_every_filter(self):
        rng = np.random.default_rng(1)
        for channels, colour in [(1, 0), (3, 2), (4, 6)]:
            picture = rng.integers(0, 256, (5, 7, channels), dtype=np.uint8)
            read = carl_env.read_png(png(picture, colour, [0, 1, 2, 3, 4]))
            self.assertTrue((read == picture[:, :, : min(channels, 3)]).all())

    def test_an_environment_describes_itself(self):
        about = served(frames=2, frame_skip=4, state=lambda env: [env.steps, 1.5]).about
        self.assertEqual((about["height"], about["width"], about["channels"], about["shades"]), (6, 8, 1, True))
        self.assertEqual((about["action_low"], about["action_high"]), ([-1.0, 0.0], [1.0, 2.0]))
        self.assertEqual((about["horizon"], about["goals"], about["states"]), (10, 1, 2))
        about = served({"grey": False, "size": [3, 4], "threshold": 9, "colour": "red"}).about
        self.assertEqual((about["height"], about["width"], about["channels"], about["shades"]), (3, 4, 3, False))

    def test_an_episode_stands_still_where_it_ends_unless_it_goes_on(self):
        for go_on, last in [(False, 30), (True, 50)]:
            envs = served(go_on=go_on, is_at_goal=lambda env: env.steps >= 3, state=lambda env: [env.steps])
            envs.reset(0, 7, 0)
            seen = [envs.step(0, (0.0, 0.0)) for _ in range(5)][-1]
            self.assertEqual(seen, (True, [last / 10], bytes([last] * 48)))

    def test_what_is_no_picture_is_refused(self):
        envs = served()
        for picture in [np.zeros((4, 4, 2)), np.zeros(4), np.full((4, 4), np.nan), np.full((4, 4), 300.0)]:
            with self.assertRaises(ValueError):
                envs.processed(picture)
        with self.assertRaises(TypeError):
            served(colour="red")


if __name__ == "__main__":
    unittest.main()
