"""Plans, simulates and exports the motion of print heads with turning, non-round nozzles.

Lengths are in mm, times in s, volumes in mm3, headings in rad; the unit is the last part of a name.
Coordinates are the part's own. Every failure is a :class:`HeadwayError` (a ``ValueError``) whose text says
where and what helps.

    >>> import headway
    >>> job = headway.plan([[(0, 0), (6, 0), (6, 6), (0, 6)]], name="square")
    >>> poses = job.poses(every_ms=1)
    >>> job.write("square.hwj")
"""

from __future__ import annotations

import functools
import hashlib
import html
import importlib
import json
import os
import pathlib
import tempfile
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _headway
from ._headway import HeadwayError, JobError, OptionsError, PartError, PlanError, __version__

if TYPE_CHECKING:
    from typing_extensions import TypedDict, Unpack

    class Options(TypedDict, total=False):
        """The options of :func:`plan`, for functions that pass them on; a misspelt one is found by a type checker."""

        aperture: Optional[str]
        speed_mm_s: Optional[float]
        wall_speed_mm_s: Optional[float]
        solid_speed_mm_s: Optional[float]
        sparse_speed_mm_s: Optional[float]
        layer_time_min_s: Optional[float]
        layer_time_max_s: Optional[float]
        outer_inner_ratio_max: Optional[float]
        continuous_z: Optional[bool]
        layer_height_mm: Optional[float]
        layers: Optional[int]
        pass_mode: Optional[str]
        heading_law: Optional[str]
        quality: Optional[str]
        tolerance_mm: Optional[float]
        overlap_pct: Optional[float]
        walls: Optional[int]
        infill_density_pct: Optional[float]
        infill_spacing_mm: Optional[float]
        bridge_max_mm: Optional[float]
        infill_angle_deg: Optional[float]
        bottom_layers: Optional[int]
        top_layers: Optional[int]
        skirt_loops: Optional[int]
        skirt_distance_mm: Optional[float]
        brim_loops: Optional[int]
        avoid_crossing: Optional[bool]
        seam: Optional[str]
        seam_direction_deg: Optional[float]
        first_layer_height_mm: Optional[float]
        layer_range: Optional[tuple[int, int]]
        curved_layers: Optional[str]
        directions: Optional[str]
        bead_width_mm: Optional[float]
        copies: Optional[int]
        copy_gap_mm: Optional[float]
        gap_mm: Optional[float]
        corner_tolerance_mm: Optional[float]
        place: Optional[str]

__all__ = [
    "STATES",
    "Block",
    "HeadwayError",
    "Job",
    "JobError",
    "OptionsError",
    "PartError",
    "PlanError",
    "Shard",
    "__version__",
    "plan",
    "plan_file",
    "plan_mesh",
    "plan_path",
    "plan_shard",
    "plan_surface",
    "read_job",
]

#: What the head does, by the number in the column ``state``.
STATES = ("travel", "prime", "print", "retract", "hold")

PathLike = Union[str, "os.PathLike[str]"]
#: A machine: the path of a machine file, or what stands in one as a mapping of its groups.
Machine = Union[str, "os.PathLike[str]", Mapping[str, Any]]
#: Called with the stage's name, the steps of it done and the steps of it in all; what it raises stops.
Progress = Callable[[str, int, int], Any]
_Rings = list[list[tuple[float, float]]]
#: A notebook keeps what its cells show: of larger pages it is given the verdict.
_INLINE_BYTES_MAX = 4_000_000
_INLINE_HEIGHT_PX = 900


class Block(NamedTuple):
    """A block of layers, planned together."""

    number: int
    #: From 1.
    first_layer: int
    last_layer: int
    #: It was in the cache before.
    was_known: bool


class Shard(NamedTuple):
    """A planned share of a mesh's blocks."""

    own: list[Block]
    #: Number of the mesh's blocks.
    blocks: int


class Job:
    """A planned job."""

    def __init__(self, native: _headway.Job) -> None:
        self._native = native

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled and copied as its file; notes are of the planning, and stay behind."""
        return (_job_of, (self.to_bytes(),))

    def __repr__(self) -> str:
        return f"<headway.Job {self.name!r}, {self.duration_s:.1f} s>"

    @property
    def name(self) -> str:
        """Name of the part."""
        return self._native.name

    @property
    def notes(self) -> list[str]:
        """What there is to know of it; of a job that was read, nothing is known any more."""
        return self._native.notes

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        return self._native.duration_s

    @property
    def figures(self) -> dict[str, Any]:
        """The figures, with the keys of ``headway plan --json``."""
        figures: dict[str, Any] = json.loads(self._native.figures_json())
        return figures

    def poses(self, every_ms: float = 1.0) -> dict[str, npt.NDArray[Any]]:
        """The poses at even steps of time, a column for each quantity.

        ``t_s``, ``layer`` (from 0), ``pass`` (from 0, -1 off the passes), ``x_mm``, ``y_mm``, ``z_mm``
        (the tip), ``nx``, ``ny``, ``nz`` (unit vector of the tool axis, the tilt), ``heading_rad``
        (about it, counter-clockwise, unwrapped), ``speed_mm_s``, ``flow_mm3_s``, ``state`` (a number into
        :data:`STATES`), as in the table of ``headway export --to csv``, and ``width_mm`` (of the bead; NaN where
        nothing is printed).
        """
        columns: dict[str, npt.NDArray[Any]] = {
            name: np.frombuffer(doubles, dtype=np.float64)
            for name, doubles in self._native.columns(every_ms * 1e-3)
        }
        for name in ("layer", "pass", "state"):
            columns[name] = columns[name].astype(np.int64)
        return columns

    def joints(self, every_ms: float = 1.0) -> dict[str, npt.NDArray[Any]]:
        """The joints at even steps of time and at the end, with the columns of ``export --to csv --joints``.

        ``t_s``, ``layer``, ``pass``, ``state``, ``volume_mm3`` (deposited so far), ``flow_mm3_s``, then for each
        joint of the machine its position (``joint_x_mm``, ``joint_1_rad``), rate (``..._mm_s``), acceleration
        (``..._mm_s2``) and whole motor steps (``joint_x_steps``), in machine coordinates; joints that turn without
        end count their turns. :attr:`machine_joints` says what the joints are.
        """
        columns: dict[str, npt.NDArray[Any]] = {
            name: np.frombuffer(doubles, dtype=np.float64)
            for name, doubles in self._native.joint_columns(every_ms * 1e-3)
        }
        for name in columns:
            if name in ("layer", "pass", "state") or name.endswith("_steps"):
                columns[name] = columns[name].astype(np.int64)
        return columns

    @property
    def machine_joints(self) -> list[dict[str, Any]]:
        """Name, unit (mm or rad), steps a unit, and range (infinite without ends) of each joint."""
        return [
            {"name": name, "unit": unit, "steps_per_unit": steps, "range": tuple(ends)}
            for name, unit, steps, ends in self._native.joint_list()
        ]

    def plot(self, ax: Any = None, every_ms: float = 5.0, layer: int = 0) -> Any:
        """Draws a layer's passes from above by matplotlib, as wide as their beads; returns the axes."""
        # By name: who does not plot needs no matplotlib, nor its types.
        collections: Any = importlib.import_module("matplotlib.collections")
        if ax is None:
            pyplot: Any = importlib.import_module("matplotlib.pyplot")
            ax = pyplot.figure().add_subplot()
        poses = self.poses(every_ms)
        shown = (poses["layer"] == layer) & np.isfinite(poses["width_mm"])
        places = np.column_stack([poses["x_mm"], poses["y_mm"]])
        # A bead between two poses of the same pass that follow each other.
        pairs = np.flatnonzero(shown[:-1] & shown[1:] & (np.diff(poses["pass"]) == 0))
        along = places[pairs + 1] - places[pairs]
        length = np.hypot(along[:, 0], along[:, 1])
        pairs, along = pairs[length > 1e-6], along[length > 1e-6] / length[length > 1e-6, None]
        across = 0.5 * np.column_stack([-along[:, 1], along[:, 0]])
        half = [across * poses["width_mm"][pairs + k, None] for k in (0, 1)]
        corners = [
            places[pairs] - half[0],
            places[pairs + 1] - half[1],
            places[pairs + 1] + half[1],
            places[pairs] + half[0],
        ]
        beads = np.stack(corners, axis=1)
        ax.add_collection(collections.PolyCollection(beads, facecolor="#0f766e", edgecolor="none", alpha=0.6))
        ax.autoscale_view()
        ax.set_aspect("equal")
        ax.set_title(f"{self.name}, layer {layer + 1}")
        return ax

    def page(self) -> str:
        """The page of ``headway view`` as one HTML text that asks for nothing else."""
        return self._native.page()

    def _repr_html_(self) -> str:
        """What a notebook shows: the page in a frame, or where it is larger than 4 MB, its verdict.

        The frame is sandboxed: its scripts can neither reach the notebook nor the network.
        """
        page = self.page()
        if len(page) > _INLINE_BYTES_MAX:
            verdict = page.partition('<p class="verdict">')[2].partition("</p>")[0]
            name = html.escape(self.name)
            return (
                f"<p><b>{name}</b>: {verdict}</p><p>Its page has {len(page) / 1e6:.0f} MB: <code>job.show()</code> opens "
                "it beside the notebook.</p>"
            )
        return (
            f'<iframe title="{html.escape(self.name)}" sandbox="allow-scripts" srcdoc="{html.escape(page)}" '
            f'style="width:100%;height:{_INLINE_HEIGHT_PX}px;border:0"></iframe>'
        )

    def show(self, path: Optional[PathLike] = None) -> str:
        """Writes the page, to a temporary file where no path is given, opens it in the browser and returns its path."""
        if path is None:
            handle, path = tempfile.mkstemp(prefix="headway-", suffix=".html")
            os.close(handle)
        path = os.path.abspath(os.fspath(path))
        _write(path, self.page().encode())
        webbrowser.open(pathlib.Path(path).as_uri())
        return path

    def simulate(
        self, link: str = "", seed: int = 1, material: Optional[PathLike] = None
    ) -> dict[str, Any]:
        """Streams it over a simulated line to the firmware library; figures of plan and run.

        ``link`` are faults of the line as in ``headway simulate --link``, ``seed`` fixes every random
        choice. ``material`` is a file as ``headway simulate --material`` takes it: figures of what is laid
        come with it. A fault of the controller, or steps that do not come to the plan's end, raise
        :class:`JobError`.
        """
        model = None if material is None else _read(material).decode()
        text, problem = self._native.simulate(link, seed, model)
        if problem is not None:
            raise JobError(problem)
        figures: dict[str, Any] = json.loads(text)
        return figures

    def to_bytes(self) -> bytes:
        """The job file, byte for byte as the command writes it."""
        return self._native.data()

    def write(self, path: PathLike) -> None:
        """Writes the job file (``.hwj``), for ``headway stream``, ``view`` and ``export``."""
        _write(path, self.to_bytes())

    def write_csv(self, path: PathLike, every_ms: float = 1.0) -> None:
        """Writes its poses with the columns of ``headway export --to csv``."""
        _write(path, self._native.csv(every_ms * 1e-3))

    def write_joints_csv(self, path: PathLike, every_ms: float = 1.0) -> None:
        """Writes its joints with the columns of ``headway export --to csv --joints``."""
        _write(path, self._native.joints_csv(every_ms * 1e-3))

    def write_trajectory(
        self,
        path: PathLike,
        every_ms: float = 10.0,
        joint_names: Optional[Sequence[str]] = None,
    ) -> None:
        """Writes a JointTrajectory message of ROS 2: ``.json``, or YAML for any other ending.

        ``joint_names`` are the robot's, in the machine's order; without them the machine file's.
        """
        is_json = os.fspath(path).lower().endswith(".json")
        names = None if joint_names is None else [str(name) for name in joint_names]
        _write(path, self._native.trajectory(every_ms * 1e-3, names, not is_json))

    def write_gcode(self, path: PathLike, dialect: str) -> None:
        """Writes G-code for klipper, reprapfirmware, linuxcnc, grblhal or marlin."""
        _write(path, self._native.gcode(dialect))

    def write_program(self, folder: PathLike, language: str, name: str) -> None:
        """Writes the files of a program in rapid, krl, urscript or sinumerik, called by that name, into a folder."""
        for file, text in self._native.program(language, name):
            _write(os.path.join(folder, file), text.encode())


def plan(
    geometry: Any,
    *,
    name: str = "part",
    machine: Optional[Machine] = None,
    keep_out: Any = None,
    at_mm: Optional[Sequence[float]] = None,
    progress: Optional[Progress] = None,
    aperture: Optional[str] = None,
    speed_mm_s: Optional[float] = None,
    wall_speed_mm_s: Optional[float] = None,
    solid_speed_mm_s: Optional[float] = None,
    sparse_speed_mm_s: Optional[float] = None,
    layer_time_min_s: Optional[float] = None,
    layer_time_max_s: Optional[float] = None,
    outer_inner_ratio_max: Optional[float] = None,
    continuous_z: Optional[bool] = None,
    layer_height_mm: Optional[float] = None,
    layers: Optional[int] = None,
    pass_mode: Optional[str] = None,
    heading_law: Optional[str] = None,
    quality: Optional[str] = None,
    tolerance_mm: Optional[float] = None,
    overlap_pct: Optional[float] = None,
    walls: Optional[int] = None,
    infill_density_pct: Optional[float] = None,
    infill_spacing_mm: Optional[float] = None,
    bridge_max_mm: Optional[float] = None,
    infill_angle_deg: Optional[float] = None,
    bottom_layers: Optional[int] = None,
    top_layers: Optional[int] = None,
    skirt_loops: Optional[int] = None,
    skirt_distance_mm: Optional[float] = None,
    brim_loops: Optional[int] = None,
    avoid_crossing: Optional[bool] = None,
    seam: Optional[str] = None,
    seam_direction_deg: Optional[float] = None,
    copies: Optional[int] = None,
    copy_gap_mm: Optional[float] = None,
) -> Job:
    """Plans an outline in mm.

    ``geometry`` is a shapely ``Polygon`` or ``MultiPolygon``, anything with ``__geo_interface__``, a GeoJSON
    mapping, one ring (points ``(x, y)``, or an array of n x 2), or a sequence of rings: the exterior, then
    its holes. ``machine`` is the path of a machine file; without it the built-in planar machine is used.
    ``keep_out``, geometry as well, is what neither aperture nor nozzle body may enter; ``at_mm`` puts the
    origin there on the machine. ``progress`` is called in this thread; what it raises, and Ctrl-C, stop the
    planning. Other threads of Python run on. The options are those of the command, ``None`` leaves the
    machine's: ``aperture`` ("ellipse:1.2x0.4", full sizes in mm), ``pass_mode`` ("two", "one"), ``heading_law``
    ("tangent", "linear"), ``quality`` ("fine", "standard", "fast"), ``seam`` ("nearest", "aligned",
    "sharpest"); lines and solid layers go with ``walls``, ``copy_gap_mm`` with ``copies``.
    """
    options = {key: value for key, value in locals().items() if key in _OPTIONS}
    part = _headway.Part.from_polygons(name, _polygons(geometry))
    return _planned(part, machine, keep_out, at_mm, progress, options)


def plan_file(
    path: PathLike,
    *,
    machine: Optional[Machine] = None,
    keep_out: Any = None,
    at_mm: Optional[Sequence[float]] = None,
    progress: Optional[Progress] = None,
    units: Optional[str] = None,
    scale: float = 1.0,
    repair: bool = False,
    centre_lines: bool = False,
    surface: Optional[PathLike] = None,
    surface_region: Optional[str] = None,
    cache: Optional[PathLike] = None,
    **options: Unpack[Options],
) -> Job:
    """Plans a file: polygon JSON, GeoJSON, SVG, DXF, STL, 3MF, OBJ, waypoints, NURBS or G-code, by its ending.

    ``units`` (mm, cm, m, um, in) and ``scale`` are of its coordinates, ``repair`` mends crossings and open
    contours by the fill rule, ``centre_lines`` prints the lines of a drawing as beads, ``bead_width_mm`` wide, in place
    of filling its contours; ``surface`` is a mesh on which an outline is laid as seen from above, or a part of it by
    ``surface_region`` as in :func:`plan_surface`. ``cache`` is a folder of planned blocks of a mesh's layers, as of
    :func:`plan_mesh`. The options are
    those of :func:`plan`, and of meshes ``first_layer_height_mm`` and ``layer_range`` (first and last, from 1) and
    ``curved_layers`` ("skin", "skin:3": layers that follow the tops) and ``directions`` ("auto",
    or the text of a file: pieces with build directions of their own), of runs of waypoints ``gap_mm``, ``corner_tolerance_mm`` and ``place`` ("centre", "best").
    """
    given = _known(options, "plan_file")
    stem, ending = _named(path)
    reading = {"units": units, "scale": scale, "repair": repair, "flatten_mm": given.get("tolerance_mm")}
    reading["centre_lines"] = centre_lines
    part = _headway.Part.from_bytes(stem, ending, _read(path), reading)
    if surface is not None:
        of_surface = {"units": units, "scale": scale, "surface_region": surface_region}
        part = part.on_surface(_named(surface)[1], _read(surface), of_surface)
    elif surface_region is not None:
        raise OptionsError("surface_region selects a part of a surface: give surface as well")
    return _planned(part, machine, keep_out, at_mm, progress, given, cache)


def plan_mesh(
    mesh: Any,
    *,
    name: str = "part",
    machine: Optional[Machine] = None,
    keep_out: Any = None,
    at_mm: Optional[Sequence[float]] = None,
    progress: Optional[Progress] = None,
    cache: Optional[PathLike] = None,
    **options: Unpack[Options],
) -> Job:
    """Plans a solid in mm, layer by layer.

    ``mesh`` is anything with ``vertices`` (n x 3) and ``faces`` (m x 3), as a ``trimesh.Trimesh``, or a pair of such
    arrays. It is closed and mended as a file is. ``cache`` is a folder in which planned blocks of layers are kept: those
    that are there, also of :func:`plan_shard` on other machines, are not planned again. The job is the same, byte for
    byte. The rest is as in :func:`plan_file`.
    """
    given = _known(options, "plan_mesh")
    part = _headway.Part.from_bytes(name, "stl", _stl(mesh), {})
    return _planned(part, machine, keep_out, at_mm, progress, given, cache)


def plan_shard(
    mesh: Any,
    shard: tuple[int, int],
    *,
    cache: PathLike,
    machine: Optional[Machine] = None,
    keep_out: Any = None,
    at_mm: Optional[Sequence[float]] = None,
    progress: Optional[Progress] = None,
    units: Optional[str] = None,
    scale: float = 1.0,
    repair: bool = False,
    **options: Unpack[Options],
) -> Shard:
    """Plans a share of a mesh's blocks of layers into ``cache``, on several machines at once; makes no job.

    ``mesh`` is a file's path as in :func:`plan_file`, or what :func:`plan_mesh` takes; ``shard`` is ``(3, 8)`` for the
    third of eight shares. That function with the same mesh, options and ``cache`` then takes all blocks from the
    folder. All machines need the same build of the package.
    """
    given = _known(options, "plan_shard")
    if isinstance(mesh, (str, os.PathLike)):
        reading = {"units": units, "scale": scale, "repair": repair, "flatten_mm": given.get("tolerance_mm")}
        part = _headway.Part.from_bytes(*_named(mesh), _read(mesh), reading)
    elif (units, scale, repair) != (None, 1.0, False):
        raise TypeError("units, scale and repair go with a file's path")
    else:
        part = _headway.Part.from_bytes("part", "stl", _stl(mesh), {})
    number, count = shard
    part = _placed(part, keep_out, at_mm, progress)
    own, blocks = _headway.plan_shard(
        part, _machine_text(machine), given, progress, _kept(cache), [int(number), int(count)]
    )
    return Shard([Block(*block) for block in own], blocks)


def plan_surface(
    surface: Any,
    outline: Any = None,
    *,
    name: str = "part",
    machine: Optional[Machine] = None,
    keep_out: Any = None,
    at_mm: Optional[Sequence[float]] = None,
    progress: Optional[Progress] = None,
    surface_region: Optional[str] = None,
    **options: Unpack[Options],
) -> Job:
    """Plans beads on curved ground: an outline as seen from above, or without one all of the surface up to its rims.

    ``surface`` is a mesh's path, or what :func:`plan_mesh` takes, closed or not; ``outline`` is geometry as in
    :func:`plan`. ``surface_region`` selects a part of the mesh: ``"group:NAME"``, ``"colour:#RRGGBB"`` (of a file that
    has them) or ``"normal:DEG"``, outward normals within that angle of Z. The rest is as there.
    """
    given = _known(options, "plan_surface")
    reading = {"surface_region": surface_region}
    if isinstance(surface, (str, os.PathLike)):
        data, ending = _read(surface), _named(surface)[1]
    else:
        data, ending = _stl(surface), "stl"
    if outline is None:
        part = _headway.Part.from_surface(name, ending, data, reading)
    else:
        part = _headway.Part.from_polygons(name, _polygons(outline)).on_surface(ending, data, reading)
    return _planned(part, machine, keep_out, at_mm, progress, given)


def plan_path(
    waypoints: Any,
    *,
    name: str = "path",
    machine: Optional[Machine] = None,
    at_mm: Optional[Sequence[float]] = None,
    progress: Optional[Progress] = None,
    **options: Unpack[Options],
) -> Job:
    """Plans a path: the tip follows the waypoints, in mm, as one pass.

    ``waypoints`` is an array of n x 3 (x, y, z; the tool upright), n x 6 (and the unit vector of the tool axis, from
    the tip into the head) or n x 7 (and ``heading_deg`` about it), or a mapping of such columns by name: ``x``, ``y``,
    ``z``, ``nx``, ``ny``, ``nz``, ``heading_deg``, ``width_mm``, ``height_mm``, ``speed_mm_s``. The rest is as in
    :func:`plan`.
    """
    given = _known(options, "plan_path")
    text = _waypoints(waypoints)
    part = _headway.Part.from_bytes(name, "wpt", text.encode("ascii"), {})
    return _planned(part, machine, None, at_mm, progress, given)


def read_job(path: PathLike) -> Job:
    """Reads a job file; one that was altered is refused with the place."""
    return _job_of(_read(path))


_OPTIONS = frozenset(plan.__kwdefaults__ or ()) - {
    "name",
    "machine",
    "keep_out",
    "at_mm",
    "progress",
} | {
    "first_layer_height_mm",
    "layer_range",
    "curved_layers",
    "directions",
    "bead_width_mm",
    "gap_mm",
    "corner_tolerance_mm",
    "place",
}


def _named(path: PathLike) -> tuple[str, str]:
    """A file's name without its ending, and that."""
    stem, ending = os.path.splitext(os.path.basename(os.fspath(path)))
    return stem, ending[1:]


def _stl(mesh: Any) -> bytes:
    """A mesh as binary STL; its normals are left to the reader."""
    vertices, faces = (mesh.vertices, mesh.faces) if hasattr(mesh, "faces") else _pair(mesh)
    try:
        corners = np.asarray(vertices, dtype=np.float64)
        triangles = np.asarray(faces, dtype=np.int64)
    except (TypeError, ValueError):
        corners, triangles = np.empty(0), np.empty(0, dtype=np.int64)
    if corners.ndim != 2 or corners.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise PartError("mesh: give vertices as an array of n x 3 and faces as one of m x 3")
    if not np.isfinite(corners).all():
        raise PartError("mesh: a coordinate is not finite")
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(corners):
        raise PartError(f"mesh: a face names a vertex that is not there; there are {len(corners)}")
    records = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    records["corners"] = corners[triangles]
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + records.tobytes()


def _pair(mesh: Any) -> tuple[Any, Any]:
    try:
        vertices, faces = mesh
    except (TypeError, ValueError):
        raise PartError(
            f"{type(mesh).__name__} is no mesh: give an object with vertices and faces, or a pair of arrays"
        ) from None
    return vertices, faces


def _known(options: Mapping[str, Any], function: str) -> dict[str, Any]:
    unknown = sorted(set(options) - _OPTIONS)
    if unknown:
        raise TypeError(f"{function}() has no option {unknown[0]}; there are {', '.join(sorted(_OPTIONS))}")
    return dict(options)


_COLUMNS = ("x", "y", "z", "nx", "ny", "nz", "heading_deg")
_MORE_COLUMNS = ("width_mm", "height_mm", "speed_mm_s")


def _waypoints(waypoints: Any) -> str:
    """The text of a waypoint file."""
    if isinstance(waypoints, Mapping):
        columns = {str(name): _column(values, str(name)) for name, values in waypoints.items()}
    else:
        try:
            rows = np.asarray(waypoints, dtype=np.float64)
        except (TypeError, ValueError):
            rows = np.empty(0)
        if rows.ndim != 2 or rows.shape[1] not in (3, 6, 7):
            raise PartError("waypoints: give an array of n x 3, n x 6 or n x 7 numbers, or columns by name")
        columns = dict(zip(_COLUMNS, rows.T))
    missing = [name for name in ("x", "y", "z") if name not in columns]
    unknown = sorted(set(columns) - set(_COLUMNS) - set(_MORE_COLUMNS))
    if missing or unknown:
        wrong = f"no column {missing[0]}" if missing else f"no such column: {unknown[0]}"
        raise PartError(f"waypoints: {wrong}; there are {', '.join(_COLUMNS + _MORE_COLUMNS)}")
    count = len(columns["x"])
    if {len(values) for values in columns.values()} != {count}:
        raise PartError("waypoints: the columns are of different lengths")
    if not {"nx", "ny", "nz"} & set(columns):
        columns.update(nx=np.zeros(count), ny=np.zeros(count), nz=np.ones(count))
    named = [name for name in _COLUMNS + _MORE_COLUMNS if name in columns]
    rows = np.column_stack([columns[name] for name in named])
    if not np.isfinite(rows).all():
        raise PartError(f"waypoint {int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])}: a number is not finite")
    # The shortest text that reads back as the same double.
    lines = [" ".join(repr(float(value)) for value in row) for row in rows]
    return "\n".join([" ".join(named), *lines, ""])


def _column(values: Any, name: str) -> npt.NDArray[np.float64]:
    try:
        column = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        column = np.empty((0, 0))
    if column.ndim != 1:
        raise PartError(f"waypoints: column {name} is no list of numbers")
    return column


def _machine_text(machine: Optional[Machine]) -> Optional[str]:
    """The text of a machine file."""
    if machine is None:
        return None
    if isinstance(machine, Mapping):
        return "\n".join(_toml(machine, ""))
    return _read(machine).decode("utf-8")


def _toml(group: Mapping[str, Any], path: str) -> list[str]:
    lines = [f"{json.dumps(str(key))} = {_toml_value(value, f'{path}{key}')}" for key, value in group.items()
             if not isinstance(value, Mapping)]
    for key, value in group.items():
        if isinstance(value, Mapping):
            lines.append(f"[{path}{json.dumps(str(key))}]")
            lines.extend(_toml(value, f"{path}{json.dumps(str(key))}."))
    return lines


def _toml_value(value: Any, key: str) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(_toml_value(item, key) for item in value) + "]"
    raise OptionsError(f"machine: {key} is {type(value).__name__}: give numbers, texts, lists or groups of them")


def _job_of(data: bytes) -> Job:
    return Job(_headway.Job.from_bytes(data))


def _planned(
    part: _headway.Part,
    machine: Optional[Machine],
    keep_out: Any,
    at_mm: Optional[Sequence[float]],
    progress: Optional[Progress],
    options: dict[str, Any],
    cache: Optional[PathLike] = None,
) -> Job:
    part = _placed(part, keep_out, at_mm, progress)
    kept = None if cache is None else _kept(cache)
    return Job(_headway.plan(part, _machine_text(machine), options, progress, kept))


def _placed(
    part: _headway.Part,
    keep_out: Any,
    at_mm: Optional[Sequence[float]],
    progress: Optional[Progress],
) -> _headway.Part:
    if progress is not None and not callable(progress):
        raise TypeError("progress is no function: give one of stage, done and total")
    if keep_out is not None:
        part = part.keeping_out(_headway.Part.from_polygons("keep_out", _polygons(keep_out)))
    if at_mm is not None:
        part = part.placed_at([float(number) for number in at_mm])
    return part


def _kept(cache: PathLike) -> tuple[str, str]:
    """The folder of planned blocks, and the program that plans."""
    return os.fspath(cache), _program()


@functools.lru_cache(maxsize=None)
def _program() -> str:
    """The planner by what it consists of: blocks of another build are not used."""
    library = _headway.__file__
    return f"python {__version__} {hashlib.sha256(_read(library) if library else b'').hexdigest()}"


def _read(path: PathLike) -> bytes:
    with open(path, "rb") as file:
        return file.read()


def _write(path: PathLike, data: bytes) -> None:
    with open(path, "wb") as file:
        file.write(data)


def _polygons(geometry: Any) -> list[_Rings]:
    """Polygons, each a list of rings, whatever they come as."""
    if hasattr(geometry, "__geo_interface__"):
        geometry = geometry.__geo_interface__
    if isinstance(geometry, Mapping):
        return _of_mapping(geometry)
    if isinstance(geometry, (str, bytes)) or not hasattr(geometry, "__iter__"):
        raise PartError(
            f"{type(geometry).__name__} is no outline: give a shapely Polygon, rings of points, or an "
            "object with __geo_interface__"
        )
    rings = list(geometry)
    if rings and _is_point(rings[0]):
        rings = [rings]
    return [[_ring(ring, number) for number, ring in enumerate(rings)]]


def _of_mapping(mapping: Mapping[str, Any]) -> list[_Rings]:
    kind = mapping.get("type")
    if kind == "Polygon":
        return [_rings(mapping)]
    if kind == "MultiPolygon":
        return [_rings({"coordinates": rings}) for rings in _list(mapping, "coordinates")]
    if kind == "GeometryCollection":
        return [found for part in _list(mapping, "geometries") for found in _polygons(part)]
    if kind == "FeatureCollection":
        return [found for part in _list(mapping, "features") for found in _polygons(part)]
    if kind == "Feature":
        return _polygons(mapping.get("geometry"))
    raise PartError(
        f"{kind} has no area: give a Polygon or MultiPolygon (a line becomes one by shapely's buffer)"
    )


def _list(mapping: Mapping[str, Any], key: str) -> list[Any]:
    found = mapping.get(key)
    if found is None or not hasattr(found, "__iter__"):
        raise PartError(f"{mapping.get('type')} has no {key}")
    return list(found)


def _rings(mapping: Mapping[str, Any]) -> _Rings:
    return [_ring(ring, number) for number, ring in enumerate(_list(mapping, "coordinates"))]


def _is_point(item: Any) -> bool:
    first = next(iter(item), None) if hasattr(item, "__iter__") else None
    return isinstance(first, (int, float, np.number))


def _ring(ring: Any, number: int) -> list[tuple[float, float]]:
    what = "the exterior" if number == 0 else f"hole {number - 1}"
    if not hasattr(ring, "__iter__"):
        raise PartError(f"{what} is {ring!r}: give its points")
    points = []
    for place, point in enumerate(ring):
        try:
            x, y = point
            points.append((float(x), float(y)))
        except (TypeError, ValueError):
            raise PartError(
                f"point {place} of {what} is {str(point)[:80]}: give two numbers, x and y in mm (shapely's "
                "force_2d drops a height)"
            ) from None
    return points
