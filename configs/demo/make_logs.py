"""Make the demo logs: a vehicle in plain NumPy at 1 kHz that shares no code with the toolkit.

    python configs/demo/make_logs.py [FOLDER]

Four runs in the canonical form, 100 Hz:

- powertrain_steps.csv: the paper's figure 3a, 30 s of velocity steps of 1 m/s, wheel straight;
- steering_steps.csv: figure 3b, 30 s of steering steps of 0.52 rad at 1 m/s;
- bend.csv, s_curve.csv: from rest to 15 km/h, then a 90 degree bend of 20 m radius, or an S-curve
  of 15 m radius, steered by pure pursuit.

The truth is linear, so that a diagnosis has nothing to find but a delay:

- powertrain (2.21 s + 143.90) / (s^2 + 18.15 s + 143.20), which has the poles of the paper's
  table 2, without the feed-through by which a speed would jump;
- steering 0.93 / (0.06 s + 1), and the command arrives 45 ms late;
- a kinematic bicycle with l_f = 1.75 m and l_r = 1.20 m.

Noise is white. The paper's FIT (88.9 %) and MSE (2.87e-3) of its powertrain imply a residual of
0.054 m/s, taken here for the speed; yaw rate and angle have the same share of theirs. As the angle
stands for one that was derived from the yaw rate, its noise falls as the speed rises.
"""

import sys
from pathlib import Path

import numpy as np

FINE = 1e-3  # s, step of the simulation
EVERY = 10  # steps per row and per command: 100 Hz
L_F, L_R = 1.75, 1.20  # m
BASE = L_F + L_R
ANGLE_GAIN, ANGLE_LAG, ANGLE_DELAY = 0.93, 0.06, 45  # -, s, steps
CRUISE = 15.0 / 3.6  # m/s

SPEED_NOISE = 0.054  # m/s
YAW_NOISE = 0.015  # rad/s
PLACE_NOISE, HEADING_NOISE = 0.02, 0.003  # m, rad

DECIMALS = {
    "t": 2,
    "v_cmd": 4,
    "delta_cmd": 5,
    "v": 4,
    "delta": 5,
    "r": 5,
    "x": 3,
    "y": 3,
    "psi": 5,
}


class Car:
    """The truth, advanced by one millisecond at a time with the commands held."""

    def __init__(self, v_cmd: float):
        self.x = self.y = self.psi = self.delta = 0.0
        self.slow, self.fast = v_cmd / 143.20, 0.0  # settled on this command
        self.pipe = [0.0] * ANGLE_DELAY

    @property
    def v(self) -> float:
        """Speed of the centre of gravity, m/s."""
        return 143.90 * self.slow + 2.21 * self.fast

    @property
    def yaw_rate(self) -> float:
        """Rate of the heading, rad/s."""
        slip = np.arctan2(L_R * np.tan(self.delta), BASE)
        return self.v * np.sin(slip) / L_R

    def advance(self, v_cmd: float, delta_cmd: float) -> None:
        """One step: Heun for the powertrain, exact for the lag, the midpoint for the pose."""
        self.pipe.append(delta_cmd)
        arrived = self.pipe.pop(0)
        v, turn, slip = self.v, self.yaw_rate, np.arctan2(L_R * np.tan(self.delta), BASE)

        push = v_cmd - 18.15 * self.fast - 143.20 * self.slow
        fast, slow = self.fast + FINE * push, self.slow + FINE * self.fast
        push_after = v_cmd - 18.15 * fast - 143.20 * slow
        self.slow += 0.5 * FINE * (self.fast + fast)
        self.fast += 0.5 * FINE * (push + push_after)
        aim = ANGLE_GAIN * arrived
        self.delta = aim + (self.delta - aim) * np.exp(-FINE / ANGLE_LAG)

        v, turn = 0.5 * (v + self.v), 0.5 * (turn + self.yaw_rate)
        slip = 0.5 * (slip + np.arctan2(L_R * np.tan(self.delta), BASE))
        course = self.psi + 0.5 * FINE * turn + slip
        self.x += FINE * v * np.cos(course)
        self.y += FINE * v * np.sin(course)
        self.psi += FINE * turn


def drive(rows: int, command, v_cmd: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A log of `rows` rows; `command(k, car)` gives both commands of row `k`, and the vehicle has
    settled on `v_cmd` before the first."""
    car = Car(v_cmd)
    log = {name: np.empty(rows) for name in DECIMALS}
    for k in range(rows):
        v_cmd, delta_cmd = command(k, car)
        row = (k * EVERY * FINE, v_cmd, delta_cmd, car.v, car.delta, car.yaw_rate)
        for name, value in zip(log, (*row, car.x, car.y, car.psi), strict=True):
            log[name][k] = value
        for _ in range(EVERY):
            car.advance(v_cmd, delta_cmd)
    cruise = max(1.0, np.abs(log["v"]).max() * 0.9)
    noise = {"v": SPEED_NOISE, "delta": YAW_NOISE * BASE / cruise, "r": YAW_NOISE}
    noise |= {"x": PLACE_NOISE, "y": PLACE_NOISE, "psi": HEADING_NOISE}
    for name, level in noise.items():
        log[name] = log[name] + level * rng.standard_normal(rows)
    return log


def steps(levels, rows: int, rng: np.random.Generator) -> np.ndarray:
    """Levels in turn, each for 1 to 3 s."""
    out, k, i = np.empty(rows), 0, 0
    while k < rows:
        hold = int(rng.integers(100, 301))
        out[k : k + hold] = levels[i % len(levels)]
        k, i = k + hold, i + 1
    return out


def track(parts, spacing: float = 0.05) -> np.ndarray:
    """Points (M, 2) along straights and arcs, given as (length in m, curvature in 1/m)."""
    points, course = [np.zeros(2)], 0.0
    for length, curvature in parts:
        for _ in range(int(round(length / spacing))):
            middle = course + 0.5 * spacing * curvature
            points.append(points[-1] + spacing * np.array([np.cos(middle), np.sin(middle)]))
            course += spacing * curvature
    return np.array(points)


class Pursuit:
    """Pure pursuit of a track by the rear axle, from rest; it knows the true pose."""

    def __init__(self, points: np.ndarray, look_ahead: float = 3.0):
        self.points, self.look_ahead, self.near = points, look_ahead, 0

    def __call__(self, k: int, car: Car) -> tuple[float, float]:
        rear = np.array([car.x - L_R * np.cos(car.psi), car.y - L_R * np.sin(car.psi)])
        self.near += int(np.argmin(np.hypot(*(self.points[self.near : self.near + 200] - rear).T)))
        away = np.hypot(*(self.points[self.near : self.near + 200] - rear).T)
        goal = self.points[self.near + int(np.argmax(away >= self.look_ahead))]
        bearing = np.arctan2(goal[1] - rear[1], goal[0] - rear[0]) - car.psi
        reach = max(np.hypot(*(goal - rear)), 1.0)
        delta = np.arctan2(2.0 * BASE * np.sin(bearing), reach)
        return (0.0 if k < 100 else CRUISE), round(float(np.clip(delta, -0.6, 0.6)), 5)


def write(path: Path, log: dict[str, np.ndarray]) -> None:
    """Canonical CSV, rounded well below the noise."""
    columns = [[f"{value:.{DECIMALS[name]}f}" for value in log[name]] for name in log]
    lines = [",".join(log), *(",".join(row) for row in zip(*columns, strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main(folder: Path) -> None:
    """Write the four logs."""
    rows = 3001
    rng = np.random.default_rng(20230218)
    v = steps([0.0, 1.0], rows, rng)
    write(folder / "powertrain_steps.csv", drive(rows, lambda k, car: (v[k], 0.0), 0.0, rng))
    delta = steps([0.0, 0.52, 0.0, -0.52], rows, rng)
    write(folder / "steering_steps.csv", drive(rows, lambda k, car: (1.0, delta[k]), 1.0, rng))
    bend = track([(20.0, 0.0), (20.0 * np.pi / 2, 1.0 / 20.0), (30.0, 0.0)])
    write(folder / "bend.csv", drive(1801, Pursuit(bend), 0.0, rng))
    arc = 15.0 * np.pi / 2
    s_curve = track([(20.0, 0.0), (arc, 1.0 / 15.0), (arc, -1.0 / 15.0), (30.0, 0.0)])
    write(folder / "s_curve.csv", drive(2101, Pursuit(s_curve), 0.0, rng))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
