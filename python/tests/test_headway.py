"""Goal: planning from Python is planning by the command. Method: areas by shapely from the poses alone,
files against the command's byte for byte, every door with bad input, exceptions and interrupts on the way.

The command is taken from HEADWAY_COMMAND or the workspace's target folder; where it is not, those tests
skip, unless HEADWAY_DEMAND_COMMAND is set.
"""

import copy
import html.parser
import math
import os
import pathlib
import pickle
import subprocess
import sys
import threading
import time
import webbrowser
import _thread

import numpy as np
import pytest
import shapely
import shapely.affinity
import shapely.geometry

import headway

ROOT = pathlib.Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
# The built-in machine's aperture, an ellipse of 1.2 x 0.4 mm: semi-axes.
MAJOR_MM, MINOR_MM = 0.6, 0.2


def command():
    path = os.environ.get("HEADWAY_COMMAND", str(ROOT / "target" / "debug" / "headway"))
    if not os.path.exists(path):
        if "HEADWAY_DEMAND_COMMAND" in os.environ:
            pytest.fail(f"{path} is not there")
        pytest.skip(f"{path} is not there: cargo build -p headway")
    return path


@pytest.fixture(scope="module")
def frame():
    return shapely.box(0, 0, 10, 7).difference(shapely.box(3.5, 2.5, 6.5, 4.5))


@pytest.fixture(scope="module")
def job(frame):
    return headway.plan(frame, name="frame")


def swept(poses):
    """Ground under the aperture while it prints: hulls of the ellipse at each two poses that follow."""
    disk = shapely.Point(0, 0).buffer(1, quad_segs=16)
    ellipse = shapely.affinity.scale(disk, MAJOR_MM, MINOR_MM)
    prints = poses["state"] == headway.STATES.index("print")
    hulls = []
    before, before_pass = None, None
    for k in np.flatnonzero(prints):
        turned = shapely.affinity.rotate(ellipse, poses["heading_rad"][k], origin=(0, 0), use_radians=True)
        here = shapely.affinity.translate(turned, poses["x_mm"][k], poses["y_mm"][k])
        if before is not None and before_pass == poses["pass"][k]:
            hulls.append(shapely.union(before, here).convex_hull)
        before, before_pass = here, poses["pass"][k]
    return shapely.union_all(hulls)


def test_poses_cover_the_polygon(frame, job):
    ground = swept(job.poses(every_ms=5))
    covered_pct = 100 * ground.intersection(frame).area / frame.area
    # A raster of 0.02 mm against polygons of 64 corners and hulls of 0.3 mm of way.
    assert covered_pct == pytest.approx(job.figures["covered_pct"], abs=0.5)
    assert covered_pct > 95
    # Hulls stand over on the inner side of a bend by the sagitta of 0.3 mm on 0.2 mm and more.
    assert ground.difference(frame.buffer(0.02)).area < 0.02


def test_joints_are_those_of_the_command_and_make_the_poses(job, tmp_path):
    joints, poses = job.joints(every_ms=2), job.poses(every_ms=2)
    assert [of["name"] for of in job.machine_joints] == ["x", "y", "z", "c"]
    assert [of["unit"] for of in job.machine_joints] == ["mm", "mm", "mm", "rad"]
    # On this machine joints are the pose itself, moved to where the part lies on the bed.
    rows = len(poses["t_s"])
    for axis in "xyz":
        offset = joints[f"joint_{axis}_mm"][:rows] - poses[f"{axis}_mm"]
        assert np.ptp(offset) < 1e-9
    assert np.abs(joints["joint_c_rad"][:rows] - poses["heading_rad"]).max() < 1e-9
    steps_per_rad = job.machine_joints[3]["steps_per_unit"]
    # Whole steps are within half a step.
    off = joints["joint_c_steps"] - joints["joint_c_rad"] * steps_per_rad
    assert np.abs(off).max() <= 0.5 + 1e-6
    assert joints["t_s"][-1] == pytest.approx(job.duration_s, abs=1e-9)
    job.write(tmp_path / "job.hwj")
    job.write_joints_csv(tmp_path / "python.csv", every_ms=2)
    job.write_trajectory(tmp_path / "python.json", every_ms=20, joint_names=["a", "b", "c", "d"])
    job.write_trajectory(tmp_path / "python.yaml", every_ms=20)
    head = (tmp_path / "python.csv").read_text().split("\n", 1)[0]
    assert head == ",".join(joints)
    with pytest.raises(headway.JobError, match="2 joint names for 4 joints"):
        job.write_trajectory(tmp_path / "no.json", joint_names=["a", "b"])
    for name, options in [
        ("python.csv", "csv --joints --every-ms 2"),
        ("python.json", "ros2-json --every-ms 20 --joint-names a,b,c,d"),
        ("python.yaml", "ros2-yaml --every-ms 20"),
    ]:
        made = [command(), "export", tmp_path / "job.hwj", "-o", tmp_path / f"of-{name}", "--to"]
        subprocess.run(made + options.split(), check=True)
        assert (tmp_path / name).read_bytes() == (tmp_path / f"of-{name}").read_bytes(), name


def test_waypoints_of_numpy_are_those_of_a_file(tmp_path):
    t = np.linspace(0, 2 * np.pi, 200)
    rows = np.column_stack([20 * np.cos(t), 20 * np.sin(t), 0.2 + 0 * t, 0 * t, 0 * t, 1 + 0 * t])
    file = tmp_path / "ring.wpt"
    lines = [" ".join(repr(float(value)) for value in row) for row in rows]
    file.write_text("\n".join(["x y z nx ny nz", *lines]) + "\n")
    of_file = headway.plan_file(file, speed_mm_s=30).to_bytes()
    assert headway.plan_path(rows, name="ring", speed_mm_s=30).to_bytes() == of_file
    assert headway.plan_path(rows[:, :3], name="ring", speed_mm_s=30).to_bytes() == of_file
    columns = dict(x=rows[:, 0], y=rows[:, 1], z=rows[:, 2], width_mm=np.full(200, 0.8))
    wide = headway.plan_path(columns, name="ring").poses(every_ms=5)
    middle = wide["width_mm"][len(wide["width_mm"]) // 2]
    assert middle == pytest.approx(0.8, abs=0.02)
    for wrong, said in [
        (rows[:, :4], "n x 3"),
        ([1, 2, 3], "n x 3"),
        ({"x": [0, 1], "y": [0, 1]}, "no column z"),
        ({**columns, "wide": t}, "no such column: wide"),
        ({**columns, "y": [0, 1]}, "different lengths"),
        (np.where(rows == rows[7, 0], np.nan, rows), "not finite"),
    ]:
        with pytest.raises(headway.PartError, match=said):
            headway.plan_path(wrong)
    with pytest.raises(TypeError, match="wals"):
        headway.plan_path(rows, wals=3)


def test_a_machine_may_be_a_mapping(frame, tmp_path):
    tomllib = pytest.importorskip("tomllib")
    file = EXAMPLES / "machines" / "planar.toml"
    machine = tomllib.loads(file.read_text())
    machine["print"]["speed_mm_s"] = 25
    changed = tmp_path / "slow.toml"
    changed.write_text(file.read_text().replace("\nspeed_mm_s = 60", "\nspeed_mm_s = 25"))
    assert changed.read_text() != file.read_text()
    of_file = headway.plan(frame, machine=changed)
    assert headway.plan(frame, machine=machine).to_bytes() == of_file.to_bytes()
    machine["print"]["speed_mm_s"] = object()
    with pytest.raises(headway.OptionsError, match="speed_mm_s"):
        headway.plan(frame, machine=machine)


def test_jobs_are_pickled_and_copied(job):
    for other in (pickle.loads(pickle.dumps(job)), copy.deepcopy(job), copy.copy(job)):
        assert other.to_bytes() == job.to_bytes()
        assert other.duration_s == job.duration_s


def test_a_plot_covers_the_part(frame, job):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    ax = job.plot()
    beads = [shapely.Polygon(path.vertices[:4]).buffer(0) for path in ax.collections[0].get_paths()]
    # Flat ends of the quads leave out the caps of the ellipse alone.
    ground = shapely.union_all(beads)
    assert ground.intersection(frame).area > 0.9 * frame.area
    assert ground.difference(frame.buffer(0.05)).area < 0.05


def test_columns_are_those_of_the_tables(job, tmp_path):
    job.write_csv(tmp_path / "poses.csv", every_ms=5)
    job.write_joints_csv(tmp_path / "joints.csv", every_ms=5)
    for table, columns in [("poses", job.poses(every_ms=5)), ("joints", job.joints(every_ms=5))]:
        head, *rows = (tmp_path / f"{table}.csv").read_text().splitlines()
        named = head.split(",")
        assert list(columns)[: len(named)] == named
        # One number a cell, the same one to the digits that the table has; the state is a word there.
        numbers = [name for name in named if name != "state"]
        cells = np.array([[float(row.split(",")[named.index(name)]) for name in numbers] for row in rows])
        assert len(cells) == len(columns["t_s"])
        ours = np.column_stack([columns[name] for name in numbers])
        scale = np.maximum(np.abs(cells).max(axis=0), 1)
        assert (np.abs(ours - cells) / scale).max() < 1e-4
    assert set(job.poses()) - set(named) >= {"width_mm"}


def test_a_notebook_shows_the_page(job, tmp_path, monkeypatch):
    page = job.page()
    assert page.startswith("<!DOCTYPE html>") and "Content-Security-Policy" in page
    # No file lies beside it, and nothing is asked for.
    assert "report.json" not in page and "src=" not in page
    shown = job._repr_html_()
    frame = html.parser.HTMLParser()
    frames = []
    frame.handle_starttag = lambda tag, attributes: frames.append((tag, dict(attributes)))
    frame.feed(shown)
    [(tag, attributes)] = frames
    assert tag == "iframe" and attributes["sandbox"] == "allow-scripts"
    assert attributes["srcdoc"] == page
    monkeypatch.setattr(headway, "_INLINE_BYTES_MAX", 1000)
    short = job._repr_html_()
    assert len(short) < 1000 and "job.show()" in short and "Takes " in short
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    path = tmp_path / "a page.html"
    assert job.show(path) == str(path) and path.read_text() == page
    temporary = pathlib.Path(job.show())
    assert temporary.read_text() == page
    temporary.unlink()
    assert opened == [path.as_uri(), temporary.as_uri()]


def test_the_page_is_that_of_the_command(job, tmp_path):
    """But for the list of files beside it, which a page by itself has not."""
    job.write(tmp_path / "frame.hwj")
    again = headway.read_job(tmp_path / "frame.hwj").page()
    report = tmp_path / "report"
    view = [command(), "view", str(tmp_path / "frame.hwj"), "--no-open", "--report", str(report)]
    subprocess.run(view, check=True, capture_output=True)
    theirs = (report / "index.html").read_text()
    files = theirs[theirs.index('<section class="card" aria-label="Files">') :]
    files = files[: files.index("</section>") + len("</section>")]
    assert again == theirs.replace(files, "")


def test_the_frame_draws_in_a_browser(job, tmp_path):
    """The page works inside of its sandbox: `host/tests/browser/frame.mjs` waits until its layer is drawn."""
    tools = pathlib.Path(os.environ.get("NODE_TOOLS", "node-tools-not-set"))
    browser = pathlib.Path(os.environ.get("CHROMIUM", "/usr/bin/chromium"))
    needed = [tools / "node_modules" / name for name in ("playwright-core", "axe-core")] + [browser]
    missing = [str(path) for path in needed if not path.exists()]
    if missing:
        assert "HEADWAY_DEMAND_BROWSER" not in os.environ, f"missing: {missing}"
        pytest.skip(f"missing: {missing}")
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!DOCTYPE html><body>{job._repr_html_()}</body>")
    script = pathlib.Path(__file__).parents[2] / "host" / "tests" / "browser" / "frame.mjs"
    look = subprocess.run(["node", str(script), str(notebook)], capture_output=True, text=True, timeout=180)
    assert look.returncode == 0, look.stdout + look.stderr
    assert "ok the layer is drawn in colours" in look.stdout, look.stdout


def test_a_type_checker_finds_a_misspelt_option(tmp_path):
    api = pytest.importorskip("mypy.api")
    file = tmp_path / "user.py"
    file.write_text("import headway\nheadway.plan_file('a.json', wals=3)\nheadway.plan_path([[0, 0, 0]], walls=3)\n")
    said, _, status = api.run(["--strict", "--cache-dir", str(tmp_path / "cache"), str(file)])
    assert status == 1 and "wals" in said and said.count("error:") == 1, said


def test_poses_are_the_figures(job):
    poses = job.poses(every_ms=1)
    assert {len(column) for column in poses.values()} == {len(poses["t_s"])}
    assert poses["t_s"][-1] == pytest.approx(job.duration_s, abs=1.1e-3)
    volume_mm3 = poses["flow_mm3_s"].sum() * 1e-3
    assert volume_mm3 == pytest.approx(job.figures["volume_mm3"], rel=0.01)
    width_mm = poses["width_mm"]
    is_print = poses["state"] == headway.STATES.index("print")
    assert np.isnan(width_mm[~is_print]).all()
    laid = width_mm[~np.isnan(width_mm)]
    assert len(laid) > 0.9 * is_print.sum()
    assert (2 * MINOR_MM - 1e-9 <= laid).all() and (laid <= 2 * MAJOR_MM + 1e-9).all()
    # The width of an ellipse across the way, from heading and differences of the tip.
    way = np.arctan2(np.gradient(poses["y_mm"]), np.gradient(poses["x_mm"]))
    turn = way - poses["heading_rad"]
    expected = 2 * np.hypot(MAJOR_MM * np.sin(turn), MINOR_MM * np.cos(turn))
    fast = is_print & (poses["speed_mm_s"] > 10)
    assert fast.sum() > 500
    # Differences of a millisecond lag in sharp bends: nearly all agree to 0.05 mm.
    assert np.mean(np.abs(expected - width_mm)[fast] < 0.05) > 0.98
    upright = poses["nz"]
    assert (upright == 1).all() and (poses["nx"] == 0).all()
    poses["x_mm"] += 1  # The arrays are the caller's.


@pytest.mark.parametrize(
    ("name", "words", "options"),
    [
        ("taper.json", [], {}),
        ("washers.geojson", [], {}),
        (
            "letter.svg",
            "--walls 1 --infill-density 40 --infill-angle 30 --speed 45 --quality fast".split(),
            {
                "walls": 1,
                "infill_density_pct": 40,
                "infill_angle_deg": 30,
                "speed_mm_s": 45,
                "quality": "fast",
            },
        ),
        ("gear-6axis.wpt", ["-m", str(EXAMPLES / "machines" / "gantry.toml")], {}),
        (
            "hook.stl",
            "--first-layer-height 0.3 --layer-range 1-2".split(),
            {"first_layer_height_mm": 0.3, "layer_range": (1, 2)},
        ),
        ("taper.json", "--copies 2 --copy-gap 3".split(), {"copies": 2, "copy_gap_mm": 3}),
    ],
)
def test_a_job_is_that_of_the_command(tmp_path, name, words, options):
    by_command = tmp_path / "command.hwj"
    plan = [command(), "plan", str(EXAMPLES / name), "-o", str(by_command), *words]
    subprocess.run(plan, check=True, capture_output=True)
    if "-m" in words:
        options = {**options, "machine": words[1]}
    job = headway.plan_file(EXAMPLES / name, **options)
    job.write(tmp_path / "python.hwj")
    is_same = (tmp_path / "python.hwj").read_bytes() == by_command.read_bytes()
    assert is_same, f"another job than that of {command()}; is that of this checkout?"
    kinds = [(["csv"], "csv"), (["gcode", "--dialect", "klipper", "--no-heat"], "gcode")]
    if name.endswith(".wpt"):
        # It tilts, and the machine file names no axes of a controller.
        kinds.pop()
        with pytest.raises(headway.JobError, match="letters"):
            job.write_gcode(tmp_path / "python.gcode", "klipper")
    for kind, ending in kinds:
        exported = tmp_path / f"command.{ending}"
        export = [command(), "export", str(by_command), "--to", *kind, "-o", str(exported)]
        subprocess.run(export, check=True, capture_output=True)
        written = tmp_path / f"python.{ending}"
        if ending == "csv":
            job.write_csv(written)
        else:
            job.write_gcode(written, "klipper")
        assert written.read_bytes() == exported.read_bytes()


def test_a_program_is_that_of_the_command(tmp_path):
    folders = {kind: tmp_path / kind for kind in ("command", "python")}
    for folder in folders.values():
        folder.mkdir()
    job_file = tmp_path / "part.hwj"
    job = headway.plan_file(EXAMPLES / "taper.json")
    job.write(job_file)
    target = folders["command"] / "part.mpf"
    export = [command(), "export", str(job_file), "--to", "sinumerik", "-o", str(target)]
    subprocess.run(export, check=True, capture_output=True)
    job.write_program(folders["python"], "sinumerik", "part")
    assert (folders["python"] / "part.mpf").read_bytes() == target.read_bytes()
    with pytest.raises(headway.JobError, match="arms"):
        job.write_program(folders["python"], "rapid", "part")
    with pytest.raises(headway.JobError, match="known language"):
        job.write_program(folders["python"], "basic", "part")


class Solid:
    """As trimesh has one."""

    def __init__(self, vertices, faces):
        self.vertices, self.faces = vertices, faces


def box(size):
    """A box's corners and triangles."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float) * size
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, [f for a, b, c, d in sides for f in ((a, b, c), (a, c, d))]


def test_a_mesh_of_arrays_is_planned():
    corners, faces = box((8, 6, 0.6))
    job = headway.plan_mesh(Solid(corners, faces), name="plate", layer_height_mm=0.2)
    assert job.name == "plate"
    poses = job.poses(every_ms=2)
    assert set(poses["layer"]) == {0, 1, 2}
    # What is laid is the box, but for its corners.
    assert 0.94 * 8 * 6 * 0.6 < job.figures["volume_mm3"] < 1.02 * 8 * 6 * 0.6
    again = headway.plan_mesh((corners, faces), name="plate", layer_height_mm=0.2)
    assert again.to_bytes() == job.to_bytes()
    for mesh in [corners, (corners, [[0, 1, 8]]), (corners * math.nan, faces), Solid([[0, 0]], faces)]:
        with pytest.raises(headway.PartError, match="mesh"):
            headway.plan_mesh(mesh)
    with pytest.raises(headway.OptionsError, match="layers goes with outlines"):
        headway.plan_mesh((corners, faces), layers=3)


def test_blocks_of_a_mesh_are_kept_and_planned_in_shares(tmp_path):
    corners, faces = box((8, 6, 3.4))
    # No two layers alike: four blocks and more.
    corners[corners[:, 2] > 0, 0] *= 0.8
    mesh, kept = (corners, faces), tmp_path / "kept"
    options = dict(layer_height_mm=0.2, quality="fast", walls=1, infill_density_pct=30)
    alone = headway.plan_mesh(mesh, **options)
    planned = headway.plan_shard(mesh, (2, 2), cache=kept, **options)
    assert planned.blocks >= 2 and planned.own[0].number == 2
    assert [block.number for block in planned.own] == list(range(2, planned.blocks + 1, 2))
    assert not any(block.was_known for block in planned.own)
    files = set(os.listdir(kept))
    assert len(files) == len(planned.own)
    # One share is lost, one file is damaged: the job is the same, and says so.
    first = kept / sorted(files)[0]
    first.write_bytes(first.read_bytes()[:-9])
    stages = []
    job = headway.plan_mesh(mesh, cache=kept, progress=lambda *step: stages.append(step), **options)
    assert job.to_bytes() == alone.to_bytes()
    assert [note for note in job.notes if "damaged" in note] and files < set(os.listdir(kept))
    assert not [note for note in alone.notes if "damaged" in note]
    # All are there now, whatever the shares: nothing is planned, and no stage of planning is reported.
    again = headway.plan_shard(mesh, (1, 1), cache=kept, **options)
    assert len(again.own) == again.blocks == planned.blocks and all(block.was_known for block in again.own)
    assert again.own[-1].last_layer == 17 and pickle.loads(pickle.dumps(again)) == again
    fewer = []
    whole = headway.plan_mesh(mesh, cache=str(kept), progress=lambda *step: fewer.append(step), **options)
    assert whole.to_bytes() == alone.to_bytes()
    assert len(fewer) < len(stages)
    # Another setting has other blocks.
    headway.plan_mesh(mesh, cache=kept, **{**options, "speed_mm_s": 41})
    assert len(os.listdir(kept)) == 2 * planned.blocks


def test_shares_that_are_none_are_refused(tmp_path):
    mesh = box((8, 6, 0.6))
    for shard in [(0, 3), (4, 3), (1, 0)]:
        with pytest.raises(headway.OptionsError, match="number of shares"):
            headway.plan_shard(mesh, shard, cache=tmp_path)
    with pytest.raises(headway.OptionsError, match="flat layers"):
        headway.plan_shard(str(EXAMPLES / "gear.json"), (1, 2), cache=tmp_path)
    with pytest.raises(headway.OptionsError, match="cache goes with a mesh in flat layers"):
        headway.plan_mesh(mesh, cache=tmp_path, curved_layers="skin")
    with pytest.raises(TypeError, match="file's path"):
        headway.plan_shard(mesh, (1, 2), cache=tmp_path, units="in")
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        headway.plan_mesh(mesh, cache=tmp_path / "file")
    assert os.listdir(tmp_path) == ["file"]


def test_a_surface_is_planned_as_by_the_command(tmp_path):
    machine = str(EXAMPLES / "machines" / "gantry.toml")
    by_command = tmp_path / "command.hwj"
    dome = EXAMPLES / "dome.stl"
    words = [str(EXAMPLES / "dome-ring.json"), "--surface", str(dome), "-m", machine]
    subprocess.run([command(), "plan", *words, "-o", str(by_command)], check=True, capture_output=True)
    job = headway.plan_file(EXAMPLES / "dome-ring.json", surface=dome, machine=machine)
    assert job.to_bytes() == by_command.read_bytes()
    # By arrays: a plane that leans by a quarter, whose beads follow it.
    corners = np.array([[-9, -9, 0], [9, -9, 4.5], [9, 9, 4.5], [-9, 9, 0]], dtype=float)
    leaning = headway.plan_surface((corners, [(0, 1, 2), (0, 2, 3)]), shapely.box(-4, -3, 4, 3), machine=machine)
    poses = leaning.poses(every_ms=2)
    prints = poses["state"] == headway.STATES.index("print")
    slope = np.polyfit(poses["x_mm"][prints], poses["z_mm"][prints], 1)[0]
    assert abs(slope - 0.25) < 0.002
    whole = headway.plan_surface((corners, [(0, 1, 2), (0, 2, 3)]), machine=machine)
    assert whole.figures["print_mm"] > 4 * leaning.figures["print_mm"]
    # Of a wedge only the side that leans by a quarter: its walls stand upright.
    solid = (
        np.vstack([corners, corners * [1, 1, 0] - [0, 0, 1]]),
        [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6), (0, 4, 5), (0, 5, 1), (1, 5, 6), (1, 6, 2), (2, 6, 7), (2, 7, 3)],
    )
    of_region = headway.plan_surface(solid, surface_region="normal:30", machine=machine)
    assert of_region.figures["print_mm"] == pytest.approx(whole.figures["print_mm"], rel=1e-9)
    with pytest.raises(headway.OptionsError, match="group:NAME"):
        headway.plan_surface(solid, surface_region="top", machine=machine)
    with pytest.raises(headway.PartError, match="surface"):
        headway.plan_file(EXAMPLES / "hook.stl", surface=dome)


def test_a_slicers_file_is_planned(tmp_path):
    sliced = tmp_path / "two.gcode"
    sliced.write_text("M83\nG1 Z0.2 F600\nG1 X10 Y10 F9000\nG1 X30 Y10 E1.2 F1800\nG1 X30 Y30 E1.2\n")
    job = headway.plan_file(sliced)
    # 2.4 mm of filament of 1.75 mm.
    assert abs(job.figures["volume_mm3"] - 2.4 * math.pi * 1.75**2 / 4) < 0.05
    with pytest.raises(headway.OptionsError, match="walls goes with outlines"):
        headway.plan_file(sliced, walls=2)


def test_paths_take_their_options():
    rows = [(x, 0.2 * x % 0.4, 0.2) for x in np.linspace(0, 20, 41)]
    path = headway.plan_path(rows, gap_mm=5, corner_tolerance_mm=0.2, place="centre")
    assert path.figures["passes"] == 1
    with pytest.raises(headway.OptionsError, match="gap_mm"):
        headway.plan_path(rows, gap_mm=-1)
    with pytest.raises(headway.OptionsError, match="centre, best"):
        headway.plan_path(rows, place="left")
    with pytest.raises(headway.OptionsError, match="layer_range goes with meshes"):
        headway.plan_path(rows, layer_range=(1, 2))


def test_curved_layers_are_those_of_the_command(tmp_path):
    gantry = EXAMPLES / "machines" / "gantry.toml"
    by_command = tmp_path / "command.hwj"
    words = ["--curved-layers", "skin:2", "--scale", "0.4", "--quality", "fast", "-m", str(gantry)]
    plan = [command(), "plan", str(EXAMPLES / "cap.stl"), "-o", str(by_command), *words]
    subprocess.run(plan, check=True, capture_output=True)
    options = {"machine": gantry, "scale": 0.4, "quality": "fast"}
    job = headway.plan_file(EXAMPLES / "cap.stl", curved_layers="skin:2", **options)
    job.write(tmp_path / "python.hwj")
    assert (tmp_path / "python.hwj").read_bytes() == by_command.read_bytes()
    curved = job.figures["curved_layers"]
    assert curved["curved_layers"] == 2
    assert curved["stair_error_mm3"] < 0.4 * curved["stair_error_flat_mm3"]
    for given, told in [
        ({"curved_layers": "some"}, "skin:M"),
        ({"curved_layers": 3}, "skin or skin:M"),
        ({"curved_layers": "skin", "copies": 2}, "in one mesh file"),
        ({"curved_layers": "skin", "layer_range": (1, 2)}, "layer_range does not go with curved_layers"),
    ]:
        with pytest.raises(headway.OptionsError, match=told):
            headway.plan_file(EXAMPLES / "cap.stl", **options, **given)


def test_geometry_comes_as_it_is(frame, job):
    exterior = list(frame.exterior.coords)
    hole = list(frame.interiors[0].coords)
    forms = [
        [exterior, hole],
        [np.array(exterior), np.array(hole)],
        (tuple(exterior), tuple(hole)),
        shapely.geometry.mapping(frame),
        {"type": "Feature", "geometry": shapely.geometry.mapping(frame), "properties": {}},
        shapely.MultiPolygon([frame]),
    ]
    for form in forms:
        assert headway.plan(form, name="frame").to_bytes() == job.to_bytes()
    square = np.array([[0, 0], [5, 0], [5, 5], [0, 5]])
    assert headway.plan(square).to_bytes() == headway.plan([square.tolist()]).to_bytes()
    two = shapely.MultiPolygon([shapely.box(0, 0, 3, 3), shapely.box(5, 0, 8, 3)])
    assert headway.plan(two).figures["area_mm2"] == pytest.approx(18, rel=1e-3)


def test_keep_out_and_place(frame):
    clamp = shapely.box(-1, -1, 2, 2)
    job = headway.plan(frame, keep_out=clamp, at_mm=[20, 30, 0])
    assert job.figures["kept_out_mm2"] > 3
    poses = job.poses(every_ms=5)
    at = poses["state"] == headway.STATES.index("print")
    tips = shapely.points(poses["x_mm"][at], poses["y_mm"][at])
    assert not shapely.intersects(clamp.buffer(MINOR_MM - 0.01), tips).any()
    with pytest.raises(headway.PlanError, match="work area|fit|reach"):
        headway.plan(frame, at_mm=[1e6, 0, 0])


BAD_GEOMETRY = [
    (None, "no outline"),
    (3, "no outline"),
    ("POLYGON ((0 0, 1 0, 1 1, 0 0))", "no outline"),
    ([], None),
    ([[]], None),
    ([[(0, 0), (1, 0)]], None),
    ([[(0, 0), (5, 0), (5, math.nan)]], None),
    ([[(0, 0), (5, 0), (5, 1e300)]], None),
    ([[(0, 0), (5, 0, 1), (5, 5)]], "point 1 of the exterior"),
    ([[(0, 0), (5, "x"), (5, 5)]], "point 1 of the exterior"),
    ([[(0, 0), (5, 5), (5, 0), (0, 5)]], "cross"),
    (shapely.LineString([(0, 0), (1, 1)]), "buffer"),
    (shapely.Polygon(), None),
    (shapely.Polygon([(0, 0, 1), (5, 0, 1), (5, 5, 1)]), "force_2d"),
    ({"type": "Polygon"}, "no coordinates"),
    ({"type": "Feature", "geometry": None}, "no outline"),
    ([5, 6], "give its points"),
]


@pytest.mark.parametrize(("geometry", "said"), BAD_GEOMETRY)
def test_bad_geometry_is_refused(geometry, said):
    with pytest.raises(headway.PartError, match=said):
        headway.plan(geometry)


BAD_OPTIONS = [
    ({"speed_mm_s": -1}, headway.OptionsError, "speed"),
    ({"speed_mm_s": math.inf}, headway.OptionsError, "speed"),
    ({"speed_mm_s": "fast"}, headway.OptionsError, "speed_mm_s is fast: give a number"),
    ({"layers": 2.5}, headway.OptionsError, "layers is 2.5: give a whole number"),
    ({"layers": -1}, headway.OptionsError, "layers"),
    ({"layers": 10**30}, headway.OptionsError, "layers"),
    ({"quality": "best"}, headway.OptionsError, "fine, standard, fast"),
    ({"seam": 3}, headway.OptionsError, "nearest"),
    ({"aperture": "star:3"}, headway.OptionsError, "star"),
    ({"aperture": 0.4}, headway.OptionsError, "aperture"),
    ({"infill_density_pct": 30}, headway.OptionsError, "how many with walls"),
    ({"at_mm": [1, 2]}, (ValueError, TypeError), None),
    ({"at_mm": [1, 2, math.nan]}, headway.PartError, "finite"),
    ({"progress": 3}, TypeError, "function"),
    ({"speed": 40}, TypeError, "speed"),
    ({"machine": "nowhere.toml"}, FileNotFoundError, "nowhere"),
]


@pytest.mark.parametrize(("options", "kind", "said"), BAD_OPTIONS)
def test_bad_options_are_refused(options, kind, said):
    with pytest.raises(kind, match=said):
        headway.plan([[(0, 0), (5, 0), (5, 5), (0, 5)]], **options)


def test_bad_files_are_refused(tmp_path, job):
    with pytest.raises(TypeError, match="no option speed"):
        headway.plan_file(EXAMPLES / "taper.json", speed=3)
    for ending, data in [("svg", b"<svg"), ("json", b"{"), ("stl", b"solid"), ("png", b"")]:
        path = tmp_path / f"bad.{ending}"
        path.write_bytes(data)
        with pytest.raises(headway.PartError):
            headway.plan_file(path)
    with pytest.raises(headway.OptionsError, match="outlines"):
        headway.plan_file(EXAMPLES / "gear-6axis.wpt", layers=2)
    with pytest.raises(headway.PartError, match="units"):
        headway.plan_file(EXAMPLES / "taper.json", units="mile")
    machine = tmp_path / "machine.toml"
    machine.write_text("[print]\nspeed = 3\n")
    with pytest.raises(headway.OptionsError):
        headway.plan([[(0, 0), (5, 0), (5, 5)]], machine=machine)
    data = bytearray(job.to_bytes())
    data[len(data) // 2] ^= 1
    altered = tmp_path / "altered.hwj"
    altered.write_bytes(data)
    with pytest.raises(headway.JobError, match="frame|checksum"):
        headway.read_job(altered)
    for every_ms in (0, -1, math.nan, 1e-12):
        with pytest.raises(headway.JobError, match="step"):
            job.poses(every_ms=every_ms)
    with pytest.raises(headway.JobError, match="klipper"):
        job.write_gcode(tmp_path / "x.gcode", "basic")


def test_a_plan_that_cannot_be_says_why():
    with pytest.raises(headway.PlanError, match="aperture"):
        headway.plan([[(0, 0), (0.1, 0), (0, 0.1)]])
    assert issubclass(headway.PlanError, ValueError)


def test_a_job_comes_back(tmp_path, job):
    job.write(tmp_path / "frame.hwj")
    again = headway.read_job(tmp_path / "frame.hwj")
    assert again.to_bytes() == job.to_bytes()
    assert again.name == "frame" and "frame" in repr(again)
    assert again.figures["passes"] == job.figures["passes"]


def test_a_simulated_run(job):
    clean = job.simulate()
    assert clean["faults"] == 0 and clean["tip_error_um_max"] < 20
    faulty = job.simulate(link="drop=0.05,flip=1e-3", seed=3)
    assert faulty["step_digest"] == clean["step_digest"]
    assert faulty["resent_frames"] > 0
    with pytest.raises(headway.JobError, match="link|drop"):
        job.simulate(link="drop=often")


def test_a_material_is_laid(tmp_path, job):
    material = tmp_path / "a.toml"
    material.write_text("format = 1\n[extruder]\nflow_loss = [[1, 0.2], [100, 0.2]]\n")
    assert "laid_mm3" not in job.simulate()
    laid = job.simulate(material=material)
    assert laid["laid_mm3"] == pytest.approx(0.8 * laid["volume_mm3"], rel=0.02)
    material.write_text("format = 1\n[extruder]\nlag_s = 40\n")
    with pytest.raises(headway.JobError, match="extruder.lag_s"):
        job.simulate(material=material)


def test_progress_is_told(frame, job):
    told = []
    thread = threading.get_ident()

    def progress(stage, done, total):
        assert threading.get_ident() == thread
        told.append((stage, done, total))

    assert headway.plan(frame, name="frame", progress=progress).to_bytes() == job.to_bytes()
    assert ("segments", told[-1][2], told[-1][2]) in told or told[-1][0] == "figures"
    for before, after in zip(told, told[1:]):
        assert after[1] > before[1] if after[0] == before[0] else after[1] == 0


class Enough(Exception):
    pass


def test_what_the_callback_raises_stops_the_planning(frame, job):
    calls = []

    def progress(stage, done, total):
        calls.append(stage)
        if stage == "segments":
            raise Enough(stage)

    with pytest.raises(Enough, match="segments"):
        headway.plan(frame, progress=progress)
    assert calls.count("segments") == 1
    # The next plan is as if nothing had been.
    assert headway.plan(frame, name="frame").to_bytes() == job.to_bytes()


# Some seconds of planning.
LONG = shapely.Point(0, 0).buffer(45).difference(shapely.Point(0, 0).buffer(12))


def test_ctrl_c_stops_the_planning():
    timer = threading.Timer(0.3, _thread.interrupt_main)
    begun = time.monotonic()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        headway.plan(LONG)
    # At once, whatever the planner is at: signals are looked for every 20 ms.
    assert time.monotonic() - begun < 2


def test_other_threads_run_while_planning(frame):
    beats = []
    end = threading.Event()

    def beat():
        while not end.wait(0.005):
            beats.append(time.monotonic())

    thread = threading.Thread(target=beat)
    thread.start()
    begun = time.monotonic()
    headway.plan(frame)
    took_s = time.monotonic() - begun
    end.set()
    thread.join()
    # With the interpreter held there would be one or two.
    assert len(beats) > min(5, took_s / 0.05)


def test_two_plans_at_once_are_the_same(frame, job):
    made = []
    threads = [
        threading.Thread(target=lambda: made.append(headway.plan(frame, name="frame").to_bytes()))
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert made == [job.to_bytes()] * 2


def test_the_package_is_typed():
    assert (pathlib.Path(headway.__file__).parent / "py.typed").exists()
    pytest.importorskip("mypy")
    check = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", os.devnull, str(ROOT / "python" / "headway")]
    found = subprocess.run(check, capture_output=True, text=True, cwd=os.path.dirname(__file__))
    assert found.returncode == 0, found.stdout


def test_the_guide_runs(tmp_path, monkeypatch, capsys):
    text = (ROOT / "docs" / "guide" / "libraries.md").read_text(encoding="utf-8")
    blocks = [block.split("```")[0] for block in text.split("```python\n")[1:]]
    assert blocks
    monkeypatch.chdir(tmp_path)
    for block in blocks:
        exec(block, {})
    assert {"disk.hwj", "disk.gcode"} <= {path.name for path in tmp_path.iterdir()}
    assert "disk" in capsys.readouterr().out
