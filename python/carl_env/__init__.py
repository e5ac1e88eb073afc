"""Makes an environment a task of carl-pipe: `[task] env = "process"`.

`serve(make)` is for environments of Gymnasium. `speak(describe)` is for any program; it needs only the standard library.
carl-pipe starts the program, and both talk over standard input and output. What the program prints goes to standard error.
"""

import inspect
import json
import os
import struct
import sys
import traceback
import zlib

PROTOCOL = 1
HELLO, RESET, STEP, SEEN, ERROR = 1, 2, 3, 4, 5


def serve(make, **settings):
    """Serves the environments that `make(**options)` makes. `options` are those of `[task.options]`.

    A setting may also stand in `[task.options]`, where it replaces the one given here:
      size        rows and columns of a picture, (64, 64) or 64 for both; None keeps those of the rendering
      crop        (top, bottom, left, right) of the part of the rendering that is kept, before it is scaled
      grey        whether a picture has one channel; True unless given
      invert      whether light and dark change places
      threshold   0..255: lighter pixels become white and all others black; None keeps the shades
      frames      pictures of an observation: 2 where one picture shows no velocity
      frame_skip  steps of the environment in a control step
      horizon     control steps of an episode; `max_episode_steps` of the environment unless given
      go_on       whether an episode goes on after the environment says `terminated`; otherwise it stands still there
      pixels      "render" for pictures of `env.render()`, "observation" where observations are pictures

    Functions of the environment. It is unwrapped for all but `goal`:
      goal        `goal(env)` returns the picture at the goal, or a list of pictures; or the path of a .png or .npy file
      is_at_goal  `is_at_goal(env)`, or `is_at_goal(env, goal)` with the number of the goal
      state       `state(env)` returns the true state, which only evaluations and recordings see
    """
    speak(lambda options: Gymnasium(make, settings, options))


class Gymnasium:
    """Environments of Gymnasium, by number."""

    SETTINGS = {
        "size": None,
        "crop": None,
        "grey": True,
        "invert": False,
        "threshold": None,
        "frames": 1,
        "frame_skip": 1,
        "horizon": None,
        "go_on": False,
        "pixels": "render",
    }
    FUNCTIONS = ("goal", "is_at_goal", "state")

    def __init__(self, make, settings, options):
        unknown = set(settings) - set(self.SETTINGS) - set(self.FUNCTIONS)
        if unknown:
            raise TypeError(f"serve has no setting {', '.join(sorted(unknown))}")
        own = {name: value for name, value in options.items() if name in self.SETTINGS}
        for name, usual in self.SETTINGS.items():
            setattr(self, name, own.get(name, settings.get(name, usual)))
        self.functions = {name: settings.get(name) for name in self.FUNCTIONS}
        rest = {name: value for name, value in options.items() if name not in self.SETTINGS}
        self.make = lambda: make(**rest)
        self.running = {}
        self.describe()

    def describe(self):
        env = self.make()
        _, info = env.reset(seed=0)
        space = env.action_space
        if not hasattr(space, "low") or len(space.shape) != 1:
            raise TypeError(f"actions must be a vector of numbers, but are {space}")
        observation = env.observation_space.sample() if self.pixels == "observation" else None
        picture = self.picture(env, observation)
        height, width = picture.shape[:2]
        horizon = self.horizon
        if horizon is None:
            steps = getattr(env.spec, "max_episode_steps", None)
            if steps is None:
                raise ValueError("the environment names no length of an episode: give `horizon`")
            horizon = steps // self.frame_skip
        state = self.functions["state"]
        goals = self.goals(env)
        wrong = next((goal.shape for goal in goals if goal.shape != picture.shape), None)
        if wrong is not None:
            raise ValueError(f"a goal picture has the shape {wrong}, pictures have {picture.shape}")
        self.shape = picture.shape
        self.about = {
            "height": height,
            "width": width,
            "channels": 1 if picture.ndim == 2 else picture.shape[2],
            "shades": self.threshold is None,
            "frames": self.frames,
            "action_low": [float(low) for low in space.low],
            "action_high": [float(high) for high in space.high],
            "horizon": horizon,
            "goals": len(goals),
            "states": 0 if state is None else len(list(state(env.unwrapped))),
        }
        self.goal_pictures = [goal.tobytes() for goal in goals]
        env.close()

    def goals(self, env):
        goal = self.functions["goal"]
        if goal is None:
            raise ValueError("give `goal`: a function that returns the picture at the goal, or a file")
        made = read_picture(goal) if isinstance(goal, (str, os.PathLike)) else goal(env)
        return [self.processed(picture) for picture in (made if isinstance(made, (list, tuple)) else [made])]

    def picture(self, env, observation):
        return self.processed(observation if self.pixels == "observation" else env.render())

    def processed(self, picture):
        """A picture as carl-pipe gets it. All arithmetic is exact, so every machine gives the same bytes."""
        import numpy as np

        picture = np.asarray(picture)
        if picture.dtype != np.uint8:
            if not np.isfinite(picture).all():
                raise ValueError("a picture holds a number that is not finite")
            if picture.min() < 0 or picture.max() > 255:
                raise ValueError("a picture holds numbers beyond 0..255")
            picture = picture.astype(np.uint8)
        if picture.ndim == 3 and picture.shape[2] == 1:
            picture = picture[:, :, 0]
        if picture.ndim not in (2, 3) or (picture.ndim == 3 and picture.shape[2] != 3):
            raise ValueError(f"a picture has the shape {picture.shape}; wanted are rows x columns, or x 3")
        if self.crop is not None:
            top, bottom, left, right = self.crop
            picture = picture[top:bottom, left:right]
        if self.size is not None:
            height, width = self.size if isinstance(self.size, (list, tuple)) else (self.size, self.size)
            area = np.uint32(picture.shape[0] * picture.shape[1])
            picture = (summed(summed(picture, height, 0), width, 1) + area // 2) // area
        picture = picture.astype(np.int64)
        if self.grey and picture.ndim == 3:
            picture = (picture @ np.array([299, 587, 114]) + 500) // 1000
        if self.invert:
            picture = 255 - picture
        if self.threshold is not None:
            picture = np.where(picture > self.threshold, 255, 0)
        return np.ascontiguousarray(picture.astype(np.uint8))

    def reset(self, number, seed, goal):
        if number not in self.running:
            self.running[number] = Running(self.make())
        running = self.running[number]
        running.goal, running.has_ended = goal, False
        observation, _ = running.env.reset(seed=seed)
        return self.seen(running, observation)

    def step(self, number, action):
        import numpy as np

        running = self.running[number]
        if running.has_ended and not self.go_on:
            return running.seen
        action = np.asarray(action, dtype=running.env.action_space.dtype)
        for _ in range(self.frame_skip):
            observation, _, terminated, _, _ = running.env.step(action)
            running.has_ended |= bool(terminated)
            if running.has_ended and not self.go_on:
                break
        return self.seen(running, observation)

    def seen(self, running, observation):
        env, at_goal, state = running.env.unwrapped, self.functions["is_at_goal"], self.functions["state"]
        picture = self.picture(running.env, observation)
        if picture.shape != self.shape:
            raise ValueError(f"a picture has the shape {picture.shape}, the first one had {self.shape}")
        if at_goal is None:
            is_at_goal = False
        elif len(inspect.signature(at_goal).parameters) > 1:
            is_at_goal = at_goal(env, running.goal)
        else:
            is_at_goal = at_goal(env)
        state = [] if state is None else [float(number) for number in state(env)]
        running.seen = (bool(is_at_goal), state, picture.tobytes())
        return running.seen


class Running:
    """An environment and its episode."""

    def __init__(self, env):
        self.env, self.goal, self.has_ended, self.seen = env, 0, False, None


def summed(picture, size, axis):
    """Cuts an axis of n pixels into `size` equal parts, and sums each. A pixel counts by its share in a part; a part sums n."""
    import numpy as np

    n = picture.shape[axis]
    picture = np.moveaxis(picture, axis, 0)
    # Arithmetic of unsigned numbers wraps around; the differences come out right.
    before = np.zeros((n + 1, *picture.shape[1:]), dtype=np.uint32)
    np.cumsum(picture, axis=0, dtype=np.uint32, out=before[1:])
    whole, rest = np.divmod(np.arange(size + 1, dtype=np.uint32) * np.uint32(n), np.uint32(size))
    rest = rest.reshape(-1, *[1] * (picture.ndim - 1))
    sums = np.uint32(size) * before[whole] + rest * picture[np.minimum(whole, n - 1)]
    return np.moveaxis(sums[1:] - sums[:-1], 0, axis)


def read_picture(path):
    """The picture in a .npy file or in a .png file of 8 bits."""
    import numpy as np

    if str(path).endswith(".npy"):
        return np.load(path)
    with open(path, "rb") as file:
        return read_png(file.read())


def read_png(data):
    """The pixels of a PNG picture of 8 bits, without interlacing, as rows x columns (x 3)."""
    import numpy as np

    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise ValueError("the file is no PNG picture")
    at, packed = 8, b""
    while at < len(data):
        (length,), kind = struct.unpack(">I", data[at : at + 4]), data[at + 4 : at + 8]
        body = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed += body
        at += length + 12
    channels = {0: 1, 2: 3, 4: 2, 6: 4}.get(colour)
    if depth != 8 or channels is None or interlaced:
        raise ValueError("only PNG pictures of 8 bits, grey or coloured, without interlacing can be read")
    raw, width = zlib.decompress(packed), width * channels
    rows = [bytearray(width)]
    for row in range(height):
        method, line = raw[row * (width + 1)], bytearray(raw[row * (width + 1) + 1 : (row + 1) * (width + 1)])
        above = rows[-1]
        for i in range(width):
            left, corner = (line[i - channels], above[i - channels]) if i >= channels else (0, 0)
            guess = left + above[i] - corner
            nearest = min((left, above[i], corner), key=lambda value: abs(guess - value))
            line[i] = (line[i] + (0, left, above[i], (left + above[i]) // 2, nearest)[method]) % 256
        rows.append(line)
    picture = np.array(rows[1:], dtype=np.uint8).reshape(height, width // channels, channels)
    return picture[:, :, : 3 if channels >= 3 else 1]


def speak(describe):
    """Speaks with carl-pipe until it goes. `describe(options)` returns an object with
    `about`, a dictionary: height, width, channels, shades, frames, action_low, action_high, horizon, goals, states;
    `goal_pictures`, a list of bytes; and `reset(number, seed, goal)` and `step(number, action)`, which both return
    (is_at_goal, state, picture). The bytes of a picture go row by row; the channels of a pixel stand side by side.
    """
    source = os.fdopen(os.dup(0), "rb")
    target = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    environments = None
    while True:
        frame = read_frame(source)
        if frame is None:
            return
        try:
            kind, body = frame[0], frame[1:]
            if kind == HELLO:
                told = json.loads(body)
                if told["protocol"] != PROTOCOL:
                    raise ValueError(f"carl-pipe speaks version {told['protocol']}, this carl_env speaks {PROTOCOL}")
                environments = describe(told["options"])
                about = json.dumps({"protocol": PROTOCOL, **environments.about}).encode()
                answer = [struct.pack("<I", len(about)), about, *environments.goal_pictures]
                write_frame(target, HELLO, b"".join(answer))
            elif kind == RESET:
                requests = struct.iter_unpack("<IQI", body[4:])
                write_seen(target, [(number, environments.reset(number, seed, goal)) for number, seed, goal in requests])
            elif kind == STEP:
                actions = struct.iter_unpack(f"<I{len(environments.about['action_low'])}d", body[4:])
                write_seen(target, [(number, environments.step(number, action)) for number, *action in actions])
            else:
                raise ValueError(f"unknown kind {kind} of message")
        except Exception as error:
            traceback.print_exc()
            write_frame(target, ERROR, f"{type(error).__name__}: {error}".encode())


def read_frame(source):
    """The next frame without its length; None at the end."""
    length = source.read(4)
    if len(length) < 4:
        return None
    frame = source.read(struct.unpack("<I", length)[0])
    return frame or None


def write_frame(target, kind, body):
    target.write(struct.pack("<IB", len(body) + 1, kind) + body)
    target.flush()


def write_seen(target, seen):
    parts = [struct.pack("<I", len(seen))]
    for number, (is_at_goal, state, picture) in seen:
        parts += [struct.pack(f"<IB{len(state)}d", number, is_at_goal, *state), picture]
    write_frame(target, SEEN, b"".join(parts))
