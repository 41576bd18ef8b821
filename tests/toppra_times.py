#!/usr/bin/env python3
"""Time of random six-joint paths against TOPP-RA (H. Pham and Q.-C. Pham, 2018), which knows no jerk.

Run by hand: python3 -m venv v; v/bin/pip install toppra; v/bin/python tests/toppra_times.py HEADWAY [COUNT]

Smooth random joint paths of examples/machines/arm-small.toml, without its nozzle joint, become waypoints
by forward kinematics; `headway plan` times them with the limits of tip and flow out of the way, once with
the machine's jerk limits and once with these lifted. TOPP-RA times the same joint paths with the same
speeds and accelerations times the plan's share. Printed: our time over its time, for each path and in all.
"""
import csv, logging, math, random, re, subprocess, sys, tempfile
from pathlib import Path

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint

toppra.setup_logging("ERROR")
logging.getLogger("toppra").setLevel(logging.ERROR)
ROOT = Path(__file__).resolve().parent.parent
SHARE = 0.95
A1, A2, C1, C2, C3, C4, TOOL = 25.0, -35.0, 400.0, 315.0, 365.0, 80.0, 120.0
OFFSET = np.radians([0, -90, 0, 0, 0, 0])
SIGN = np.array([-1, 1, 1, -1, 1, -1])
CENTRE = np.radians([0, -70, 110, 0, 45, 0])
WAYPOINTS = 600


def about(axis, angle):
    c, s = math.cos(angle), math.sin(angle)
    if axis == "z":
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def pose(joints):
    """Tip, mm, and the tool's axes by columns: Z from the tip into the head."""
    t = SIGN * joints - OFFSET
    base, upper = about("z", t[0]), about("y", t[1])
    forearm = about("y", t[1] + t[2])
    wrist = base @ (upper @ [0, 0, C2] + forearm @ [A2, 0, C3] + [A1, 0, C1])
    flange = base @ forearm @ about("z", t[3]) @ about("y", t[4]) @ about("z", t[5])
    return wrist + flange @ [0, 0, C4 + TOOL], flange @ np.diag([1, -1, -1])


def waypoint(joints):
    tip, axes = pose(joints)
    n = axes[:, 2]
    least = np.array(
        [
            [1 - n[0] * n[0] / (1 + n[2]), -n[0] * n[1] / (1 + n[2]), n[0]],
            [-n[0] * n[1] / (1 + n[2]), 1 - n[1] * n[1] / (1 + n[2]), n[1]],
            [-n[0], -n[1], n[2]],
        ]
    )
    long = least.T @ axes[:, 0]
    return [*tip, *n, math.degrees(math.atan2(long[1], long[0]))]


def random_path(seed):
    """A spline through six random places of the joints, and the limits' share."""
    rng = random.Random(seed)
    places = [CENTRE + np.radians([rng.uniform(-22, 22) for _ in range(6)]) for _ in range(6)]
    return toppra.SplineInterpolator(np.linspace(0, 1, 6), np.array(places))


def machine_text(jerk_factor):
    text = (ROOT / "examples/machines/arm-small.toml").read_text()
    text = re.sub(r"\n# The nozzle about its axis[^\[]*\[joints\.h\][^\[#]*", "\n", text)
    text = re.sub(r"base_mm = .*", "base_mm = [0, 0, 0]", text)
    text = re.sub(r"base_roll_pitch_yaw_deg = .*", "base_roll_pitch_yaw_deg = [0, 0, 0]", text)
    text = re.sub(r"min_mm = .*", "min_mm = [-2000, -2000, -2000]", text)
    text = re.sub(r"max_mm = .*", "max_mm = [2000, 2000, 2000]", text)
    jerk = lambda found: f"{found[1]}{float(found[2]) * jerk_factor}"
    text = re.sub(r"(jerk_max_deg_s3 = )(.*)", jerk, text)
    # What binds is the joints, nothing else.
    for key, value in [
        ("speed_mm_s", 5000), ("tip_acceleration_mm_s2", 1000000), ("flow_max_mm3_s", 5000),
        ("rate_of_change_max_mm3_s2", 1000000), ("steps_per_mm3", 1), ("speed_max_mm3_s", 20000),
        ("acceleration_max_mm3_s2", 10000000), ("pressure_advance_s", 0),
    ]:
        text = re.sub(rf"(?m)^{key} = .*", f"{key} = {value}", text)
    return text


def limits():
    text = (ROOT / "examples/machines/arm-small.toml").read_text()
    of = lambda key: [
        float(re.search(rf"\[joints\.j{j}\][^\[]*{key} = (\S+)", text)[1]) for j in range(1, 7)
    ]
    speed, acceleration = (SHARE * np.radians(of(key)) for key in ("speed_max_deg_s", "acceleration_max_deg_s2"))
    return np.stack([-speed, speed], 1), np.stack([-acceleration, acceleration], 1)


def ours(headway, folder, path, jerk_factor):
    machine, run, job = folder / "arm.toml", folder / "run.wpt", folder / "run.hwj"
    machine.write_text(machine_text(jerk_factor))
    lines = [waypoint(path(u)) for u in np.linspace(0, 1, WAYPOINTS)]
    run.write_text("".join(" ".join(f"{v:.9f}" for v in line) + "\n" for line in lines))
    command = [headway, "plan", "--quiet", "--from", "waypoints", "-m", machine, "--at", "0,0,0",
               "--gap", "1000", "--axis-tolerance", "0", run, "-o", job]
    planned = subprocess.run(command, capture_output=True, text=True)
    if planned.returncode:
        return None, planned.stderr.strip().splitlines()[-1]
    table = subprocess.run([headway, "export", job, "--to", "csv"], capture_output=True, text=True, check=True)
    rows = [row for row in csv.DictReader(table.stdout.splitlines()) if row["state"] == "print"]
    return (float(rows[-1]["t_s"]) - float(rows[0]["t_s"])), ""


def theirs(path):
    speed, acceleration = limits()
    constraints = [
        toppra.constraint.JointVelocityConstraint(speed),
        toppra.constraint.JointAccelerationConstraint(
            acceleration, toppra.constraint.DiscretizationType.Interpolation
        ),
    ]
    instance = toppra.algorithm.TOPPRA(
        constraints, path, gridpoints=np.linspace(0, 1, 2001), parametrizer="ParametrizeConstAccel"
    )
    return instance.compute_trajectory(0, 0).duration


def main():
    headway, count = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 20
    ratios = {1: [], 1000: []}
    with tempfile.TemporaryDirectory() as name:
        seed = 0
        while len(ratios[1]) < count and seed < 10 * count:
            seed += 1
            path = random_path(seed)
            told = [ours(headway, Path(name), path, factor) for factor in ratios]
            if any(seconds is None for seconds, _ in told):
                print(f"path {seed}: left out: {told[0][1] or told[1][1]}", file=sys.stderr)
                continue
            least = theirs(path)
            for (seconds, _), kept in zip(told, ratios.values()):
                kept.append(seconds / least)
            print(f"path {seed}: TOPP-RA {least:.3f} s, ours {told[0][0]:.3f} s ({ratios[1][-1]:.3f}), "
                  f"jerk lifted {told[1][0]:.3f} s ({ratios[1000][-1]:.3f})")
    for label, kept in zip(("with jerk limits", "jerk lifted"), ratios.values()):
        print(f"{label}: mean {np.mean(kept):.3f}, worst {max(kept):.3f} over {len(kept)} paths")


main()
