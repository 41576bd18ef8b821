#!/usr/bin/env python3
"""Time of random six-joint paths against TOPP-RA (H. Pham and Q.-C. Pham, 2018), which knows no jerk.

Run by hand: python3 -m venv v; v/bin/pip install toppra; v/bin/python tests/toppra_times.py HEADWAY [COUNT]

Smooth random joint paths of examples/machines/arm-small.toml, without its nozzle joint, become waypoints
by forward kinematics; `headway plan` times them with the limits of tip and flow out of the way, once with
the machine's jerk limits and once with these lifted. TOPP-RA times the same joint paths with the same
speeds and accelerations times the plan's share. Printed: our time over its time, for each path and in all.

With `real` in place of COUNT: the runs of ../shared/data/waypoints on examples/machines/trunnion.toml, with the limits of
tip acceleration and flow out of the way. TOPP-RA gets the joints of the motion that was planned (equations of its own),
the way of the tip as one more joint with the print speed, and the speeds at both ends: the longest stretch without a rest, at most 8 s of it.
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


def table_joints(rows, centre):
    """X Y Z A C H of the table machine for poses (tip in machine coordinates, tool axis, heading)."""
    tip, n, heading = rows[:, :3] - centre, rows[:, 3:6], rows[:, 6]
    tilt = np.arctan2(np.hypot(n[:, 0], n[:, 1]), n[:, 2])
    turn = np.unwrap(np.arctan2(-n[:, 0], -n[:, 1]))
    s, c = np.sin(turn), np.cos(turn)
    across = s * tip[:, 0] + c * tip[:, 1]
    sa, ca = np.sin(-tilt), np.cos(-tilt)
    return np.stack([
        c * tip[:, 0] - s * tip[:, 1], ca * across - sa * tip[:, 2], sa * across + ca * tip[:, 2],
        -tilt, turn, np.unwrap(heading + turn),
    ], 1)


def table_limits(text):
    of = lambda joint, key, scale: scale * SHARE * float(re.search(rf"\[joints\.{joint}\][^\[]*{key} = (\S+)", text)[1])
    both = []
    for kind in ("speed_max", "acceleration_max"):
        power = "2" if kind == "acceleration_max" else ""
        most = [of(j, f"{kind}_mm_s{power}", 1.0) for j in "xyz"]
        most += [of(j, f"{kind}_deg_s{power}", math.pi / 180) for j in "ach"]
        most.append(SHARE * float(re.search(r"(?m)^speed_mm_s = (\S+)", text)[1]) if kind == "speed_max" else 1e6)
        both.append(np.stack([-np.array(most), np.array(most)], 1))
    return both


def real_run(headway, folder, run, jerk_factor):
    """Our time and TOPP-RA's on the first seconds of a run's print, or None and why."""
    text = (ROOT / "examples/machines/trunnion.toml").read_text()
    jerk = lambda found: f"{found[1]}{float(found[2]) * jerk_factor}"
    text = re.sub(r"(jerk_max_\w+ = )(.*)", jerk, text)
    for key, value in [
        ("tip_acceleration_mm_s2", 1000000), ("flow_max_mm3_s", 5000), ("rate_of_change_max_mm3_s2", 1000000),
        ("steps_per_mm3", 1), ("speed_max_mm3_s", 20000), ("acceleration_max_mm3_s2", 10000000),
        ("pressure_advance_s", 0),
    ]:
        text = re.sub(rf"(?m)^{key} = .*", f"{key} = {value}", text)
    machine, job = folder / "table.toml", folder / "run.hwj"
    machine.write_text(text)
    low = min(float(re.split(r"[,;\s]+", line.strip())[2]) for line in run.read_text().splitlines() if line.strip())
    up = 30.0 - min(0.0, low)
    command = [headway, "plan", "--quiet", "-m", machine, "--at", f"150,150,{up}", "--axis-tolerance", "0.5", run, "-o", job]
    planned = subprocess.run(command, capture_output=True, text=True)
    if planned.returncode:
        return None, planned.stderr.strip().splitlines()[-1]
    table = subprocess.run([headway, "export", job, "--to", "csv"], capture_output=True, text=True, check=True)
    names = ["x_mm", "y_mm", "z_mm", "nx", "ny", "nz", "heading_rad", "t_s", "speed_mm_s"]
    rows = [[float(row[name]) for name in names] for row in csv.DictReader(table.stdout.splitlines())
            if row["state"] == "print"]
    rows = np.array(rows)
    rows[:, :3] += [150.0, 150.0, up]
    # The longest stretch without a rest, from the way up to speed to the way down, so that nothing is near rest.
    moving = np.concatenate([[0], (rows[:, 8] > 5.0).astype(int), [0]])
    begins, ends = np.nonzero(np.diff(moving) == 1)[0], np.nonzero(np.diff(moving) == -1)[0]
    longest = int(np.argmax(ends - begins))
    rows = rows[begins[longest] : min(ends[longest], begins[longest] + 8000)]
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rows[:, :3], axis=0), axis=1))])
    # Every 0.15 mm: finer, the digits of the table would show as acceleration.
    keep = [0]
    for index in range(1, len(rows)):
        if way[index] - way[keep[-1]] >= 0.15:
            keep.append(index)
    rows, way = rows[keep], way[keep]
    if len(rows) < 60:
        return None, "no stretch without a rest"
    joints = np.hstack([table_joints(rows, np.array([150.0, 150.0, 0.0])), way[:, None]])
    path = toppra.SplineInterpolator(way, joints)
    speed, acceleration = table_limits(text)
    constraints = [
        toppra.constraint.JointVelocityConstraint(speed),
        toppra.constraint.JointAccelerationConstraint(
            acceleration, toppra.constraint.DiscretizationType.Interpolation
        ),
    ]
    grid = np.linspace(0, way[-1], int(way[-1] / 0.05) + 2)
    instance = toppra.algorithm.TOPPRA(constraints, path, gridpoints=grid, parametrizer="ParametrizeConstAccel")
    trajectory = instance.compute_trajectory(0.97 * rows[0, 8], 0.97 * rows[-1, 8])
    if trajectory is None:
        return None, "TOPP-RA finds no motion with these speeds at the ends"
    ours_s = rows[-1, 7] - rows[0, 7]
    return ours_s / trajectory.duration, f"{ours_s:.3f} s"


def real(headway):
    ratios = {1: [], 1000: []}
    with tempfile.TemporaryDirectory() as name:
        for run in sorted((ROOT / "../shared/data/waypoints").glob("*.txt")):
            for factor, kept in ratios.items():
                ratio, why = real_run(headway, Path(name), run, factor)
                print(f"{run.name}, jerk x{factor}: {f'{ratio:.3f} of {why}' if ratio else 'left out: ' + why}", flush=True)
                if ratio:
                    kept.append(ratio)
    for factor, kept in ratios.items():
        if kept:
            print(f"jerk x{factor}: {len(kept)} runs, mean {np.mean(kept):.3f}, worst {max(kept):.3f}")


def main():
    if sys.argv[2:] == ["real"]:
        return real(sys.argv[1])
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
