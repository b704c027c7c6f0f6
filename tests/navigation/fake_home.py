"""A home of two rooms drawn by hand, a robot that does as it is told, and a mapper that sees things without error."""

from functools import cached_property

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Layout, Room, Volatile
from seo_slam.camera import Camera
from seo_slam.records import StepResult
from seo_slam.types import Frame, Landmark

CAMERA = Camera(266.0, 266.0, 159.5, 119.5, 320, 240)
EYE_M, DOWN_RAD = 1.3, 0.17
CELL_M = 0.1
KITCHEN, STUDY = 1, 2
WORDS = ("table", "desk", "shelf", "counter", "mug", "cup", "book", "banana", "lamp")


class WordEmbedder:
    """Words are at right angles to each other, but for a mug and a cup (cosine 0.95)."""

    name = "words"
    size = len(WORDS)

    def embed_text(self, texts):
        rows = np.zeros((len(texts), self.size))
        for row, text in zip(rows, texts, strict=True):
            if text in WORDS:
                row[WORDS.index(text)] = 1.0
            if text == "cup":
                row[WORDS.index("mug")] = 3.0
        lengths = np.linalg.norm(rows, axis=1, keepdims=True)
        return rows / np.where(lengths > 0, lengths, 1.0)


EMBEDDER = WordEmbedder()


class Thing:
    """A box with a name."""

    def __init__(self, id, label, center, size):
        self.id, self.label = id, label
        self.center, self.size = np.array(center, dtype=float), np.array(size, dtype=float)

    @cached_property
    def cloud(self):
        ticks = [np.arange(-s / 2, s / 2 + 1e-9, min(0.05, s)) for s in self.size]
        grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
        on_surface = (np.abs(np.abs(grid) - self.size / 2) < 0.026).any(axis=1)
        return self.center + grid[on_surface]


def furniture():
    """A table and a counter in the kitchen (x < 4), a desk and a shelf in the study."""
    return [
        Thing(1, "table", (1.5, 3.5, 0.36), (1.0, 0.7, 0.72)),
        Thing(2, "counter", (0.4, 1.0, 0.45), (0.6, 1.4, 0.9)),
        Thing(3, "desk", (7.5, 3.6, 0.36), (0.7, 1.2, 0.72)),
        Thing(4, "shelf", (6.0, 0.4, 0.5), (1.2, 0.4, 1.0)),
    ]


def resting(id, label, carrier, dx=0.0, dy=0.0):
    """A small thing on a piece of furniture."""
    top = carrier.center[2] + carrier.size[2] / 2
    return Thing(id, label, (carrier.center[0] + dx, carrier.center[1] + dy, top + 0.05), (0.08, 0.08, 0.1))


def layout(things, door=True, cell_m=CELL_M):
    """8 x 5 m with a wall at x = 4 and a door in it at 2 < y < 3."""
    rows, columns = 50, 80
    walls = np.zeros((rows, columns), dtype=bool)
    walls[[0, -1]] = walls[:, [0, -1]] = True
    walls[:, 40] = True
    if door:
        walls[20:30, 40] = False
    obstacles = np.zeros_like(walls)
    rooms = np.zeros(walls.shape, dtype=np.int16)
    rooms[1:-1, 1:40], rooms[1:-1, 41:-1] = KITCHEN, STUDY
    for thing in things:
        low, high = (np.floor((thing.center + sign * thing.size / 2)[:2] / cell_m).astype(int) for sign in (-1, 1))
        obstacles[low[1] : high[1] + 1, low[0] : high[0] + 1] = True
        rooms[low[1] : high[1] + 1, low[0] : high[0] + 1] = 0
    return Layout(np.zeros(2), cell_m, walls, obstacles, ~walls & ~obstacles, rooms)


def abstract_map(things, small, door=True):
    """The map of a home: ``small`` are (thing, carrier) pairs."""
    anchors = []
    for thing in things:
        on = [Volatile(s.label, EMBEDDER.embed_text([s.label])[0], "on", s.id) for s, carrier in small if carrier is thing]
        xy = thing.cloud[:, :2]
        top = thing.center[2] + thing.size[2] / 2
        z_range = (thing.center[2] - thing.size[2] / 2, top)
        feature = EMBEDDER.embed_text([thing.label])[0]
        anchors.append(Anchor(thing.id, thing.label, feature, np.unique(xy.round(3), axis=0), len(xy), z_range, top, tuple(on)))
    rooms = (Room(KITCHEN, "kitchen", 18.0), Room(STUDY, "study", 18.0))
    return AbstractMap(tuple(anchors), layout(things, door), rooms, EMBEDDER.name)


class Robot:
    """Drives as it is told, 6 frames a second; ``stuck`` lets it turn only."""

    def __init__(self, xy=(2.0, 2.0), yaw_rad=0.0):
        self.xy, self.yaw_rad = np.array(xy, dtype=float), float(yaw_rad)
        self.time_s, self.index, self.stuck, self.driven = 0.0, 0, False, [self.xy.copy()]

    @property
    def T_world_camera(self):
        c, s, down = np.cos(self.yaw_rad), np.sin(self.yaw_rad), DOWN_RAD
        ahead = np.array([c * np.cos(down), s * np.cos(down), -np.sin(down)])
        right = np.array([s, -c, 0.0])
        T = np.eye(4)
        T[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        T[:3, 3] = [*self.xy, EYE_M]
        return T

    def frame(self):
        depth = np.full((240, 320), 9.0, dtype=np.float32)
        return Frame(self.time_s, np.zeros((240, 320, 3), dtype=np.uint8), depth, CAMERA, self.index)

    def drive(self, command):
        self.time_s, self.index = round(self.time_s + 1 / 6, 6), self.index + 1
        aim = command.yaw_rad
        if command.kind == "go":
            way = command.xy_world - self.xy
            aim = np.arctan2(way[1], way[0])
        if command.kind == "stop" or aim is None:
            return
        off = (aim - self.yaw_rad + np.pi) % (2 * np.pi) - np.pi
        self.yaw_rad += float(np.clip(off, -0.15, 0.15))
        if command.kind == "go" and abs(off) < 0.4 and not self.stuck:
            length = np.linalg.norm(way)
            self.xy = self.xy + way / max(length, 1e-9) * min(length, 0.09)
            self.driven.append(self.xy.copy())


class Local:
    """A map as of ``Mapper.snapshot``."""

    def __init__(self, landmarks):
        self.landmarks = tuple(landmarks)


class SeeingMapper:
    """Sees every thing in view within some metres and not behind the wall, from where the robot truly is.

    ``says`` maps a thing's id to the word that it is taken for: a word, or a function of the distance in metres. What was not seen for
    ``keeps_s`` is dropped, and is a new landmark when it is seen again.
    """

    def __init__(self, robot, things, range_m=4.0, says=None, door=True, keeps_s=np.inf):
        self.robot, self.things, self.range_m, self.says, self.door = robot, list(things), range_m, says or {}, door
        self.seen, self.words, self.last_s, self.lost_frames = {}, {}, {}, set()
        self.keeps_s, self.ids = keeps_s, {thing.id: 100 + thing.id for thing in self.things}

    def step(self, frame):
        T = self.robot.T_world_camera
        if frame.index in self.lost_frames:
            return StepResult(frame.index, frame.timestamp_s, T, "lost")
        for thing in self.things:
            p = T[:3, :3].T @ (thing.center - T[:3, 3])
            uv = CAMERA.project(p)
            away = np.linalg.norm(p)
            in_view = p[2] > 0.1 and 0 <= uv[0] < 320 and 0 <= uv[1] < 240
            if in_view and away < self.range_m and not self._behind_wall(thing):
                word = self.says.get(thing.id, thing.label)
                self.words.setdefault(thing.id, []).append(word(away) if callable(word) else word)
                self.seen[thing.id] = self.seen.get(thing.id, 0) + 1
                self.last_s[thing.id] = frame.timestamp_s
        for id in [id for id, last_s in self.last_s.items() if frame.timestamp_s - last_s > self.keeps_s]:
            del self.seen[id], self.words[id], self.last_s[id]
            self.ids[id] += 1000
        return StepResult(frame.index, frame.timestamp_s, T, "ok", keyframe_id=frame.index)

    def snapshot(self):
        return Local(self._landmark(thing) for thing in self.things if thing.id in self.seen)

    def _landmark(self, thing):
        words = self.words[thing.id][-6:]
        vectors = EMBEDDER.embed_text(words).mean(axis=0)
        label = max(sorted(set(words)), key=words.count)
        return Landmark(
            self.ids[thing.id], label, {label: 1.0}, thing.center, np.eye(3) * 1e-4, thing.size, vectors / np.linalg.norm(vectors),
            self.seen[thing.id], 0.0, self.last_s[thing.id], "stable", cloud_world=thing.cloud,
        )  # fmt: skip

    def _behind_wall(self, thing):
        a, b = self.robot.xy, thing.center[:2]
        if (a[0] - 4.05) * (b[0] - 4.05) > 0:
            return False
        y = a[1] + (b[1] - a[1]) * (4.05 - a[0]) / (b[0] - a[0])
        return not (self.door and 2.0 < y < 3.0)


def drive(navigator, robot, most=4000):
    """Drive until there is an outcome."""
    for _ in range(most):
        if navigator.outcome is not None:
            break
        robot.drive(navigator.step(robot.frame()))
    return navigator.outcome
