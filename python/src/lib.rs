//! The native half of the Python package: `headway::api` for Python.
//!
//! In: polygons or a file's bytes, options as a dict, a function for progress. Out: jobs, their columns as
//! bytes of doubles, which the Python half hands to numpy. Planning runs in a thread without the
//! interpreter; whoever called waits, tells progress and looks for signals. Every failure is an
//! exception, a panic of the planner too. Leaves out the shapes of geometry, which the Python half reads.

mod blocks;
mod options;
mod planning;

use headway::api::{self, Error, MotionState};
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes, PyDict};

create_exception!(
    _headway,
    HeadwayError,
    PyValueError,
    "Something cannot be done as asked; the text says where and what helps."
);
create_exception!(_headway, PartError, HeadwayError, "The outline or path.");
create_exception!(
    _headway,
    OptionsError,
    HeadwayError,
    "The machine file or an option."
);
create_exception!(
    _headway,
    PlanError,
    HeadwayError,
    "The part cannot be planned as asked."
);
create_exception!(
    _headway,
    JobError,
    HeadwayError,
    "A job file, or what is to be made of a job."
);

/// An error of the library as an exception, options called as Python calls them.
fn exception(error: Error) -> PyErr {
    let text = options::as_keywords(&error.to_string());
    match error {
        Error::Part(_) => PartError::new_err(text),
        Error::Options(_) => OptionsError::new_err(text),
        Error::Plan(_) => PlanError::new_err(text),
        Error::Job(_) => JobError::new_err(text),
        _ => HeadwayError::new_err(text),
    }
}

/// What is to be printed.
#[pyclass(frozen, module = "headway._headway")]
struct Part(api::Part);

#[pymethods]
impl Part {
    #[staticmethod]
    fn from_polygons(
        py: Python<'_>,
        name: &str,
        polygons: Vec<Vec<Vec<[f64; 2]>>>,
    ) -> PyResult<Part> {
        let part = py.detach(|| api::Part::from_polygons(name, &polygons));
        part.map(Part).map_err(exception)
    }

    #[staticmethod]
    fn from_bytes(
        py: Python<'_>,
        name: &str,
        ending: &str,
        data: &[u8],
        reading: &Bound<'_, PyDict>,
    ) -> PyResult<Part> {
        let reading = options::reading(reading)?;
        let part = py.detach(|| api::Part::from_bytes(name, ending, data, &reading));
        part.map(Part).map_err(exception)
    }

    #[staticmethod]
    fn from_surface(
        py: Python<'_>,
        name: &str,
        ending: &str,
        data: &[u8],
        reading: &Bound<'_, PyDict>,
    ) -> PyResult<Part> {
        let reading = options::reading(reading)?;
        let part = py.detach(|| api::Part::from_surface(name, ending, data, &reading));
        part.map(Part).map_err(exception)
    }

    fn on_surface(
        &self,
        py: Python<'_>,
        ending: &str,
        data: &[u8],
        reading: &Bound<'_, PyDict>,
    ) -> PyResult<Part> {
        let (part, reading) = (self.0.clone(), options::reading(reading)?);
        let part = py.detach(|| part.on_surface(ending, data, &reading));
        part.map(Part).map_err(exception)
    }

    fn keeping_out(&self, other: &Part) -> PyResult<Part> {
        let part = self.0.clone().keeping_out(&other.0);
        part.map(Part).map_err(exception)
    }

    fn placed_at(&self, at_mm: [f64; 3]) -> PyResult<Part> {
        let part = self.0.clone().placed_at(at_mm);
        part.map(Part).map_err(exception)
    }
}

/// A planned job.
#[pyclass(frozen, module = "headway._headway")]
struct Job(api::Job);

/// Columns of the poses, in the order of [`Job::columns`]: those of the command's table, and the width behind them.
const COLUMNS: [&str; 14] = [
    "t_s",
    "layer",
    "pass",
    "x_mm",
    "y_mm",
    "z_mm",
    "nx",
    "ny",
    "nz",
    "heading_rad",
    "speed_mm_s",
    "flow_mm3_s",
    "state",
    "width_mm",
];

/// Number of a state, as its place in `headway.STATES`.
fn state_number(state: MotionState) -> f64 {
    f64::from(match state {
        MotionState::Travel => 0u8,
        MotionState::Prime => 1,
        MotionState::Print => 2,
        MotionState::Retract => 3,
        MotionState::Hold => 4,
    })
}

#[pymethods]
impl Job {
    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: Vec<u8>) -> PyResult<Job> {
        let job = py.detach(|| api::Job::from_bytes(data));
        job.map(Job).map_err(exception)
    }

    #[getter]
    fn name(&self) -> &str {
        self.0.name()
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0
            .notes()
            .iter()
            .map(|note| options::as_keywords(note))
            .collect()
    }

    #[getter]
    fn duration_s(&self) -> f64 {
        self.0.duration_s()
    }

    fn data<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, self.0.bytes())
    }

    fn figures_json(&self) -> String {
        self.0.figures_json()
    }

    /// Name and doubles of each column.
    fn columns<'py>(
        &self,
        py: Python<'py>,
        every_s: f64,
    ) -> PyResult<Vec<(&'static str, Bound<'py, PyByteArray>)>> {
        let columns = py.detach(|| columns(&self.0, every_s)).map_err(exception)?;
        let named = COLUMNS.into_iter().zip(columns);
        Ok(named
            .map(|(name, doubles)| (name, PyByteArray::new(py, &doubles)))
            .collect())
    }

    fn csv<'py>(&self, py: Python<'py>, every_s: f64) -> PyResult<Bound<'py, PyBytes>> {
        let mut text = Vec::new();
        let written = py.detach(|| self.0.write_csv(&mut text, every_s));
        written.map_err(exception)?;
        Ok(PyBytes::new(py, &text))
    }

    /// Name, unit, steps a unit and both ends of each joint.
    fn joint_list(&self) -> Vec<(String, &'static str, f64, [f64; 2])> {
        let joints = self.0.joints().into_iter();
        joints
            .map(|joint| (joint.name, joint.unit, joint.steps_per_unit, joint.range))
            .collect()
    }

    /// Name and doubles of each column of the joints.
    fn joint_columns<'py>(
        &self,
        py: Python<'py>,
        every_s: f64,
    ) -> PyResult<Vec<(String, Bound<'py, PyByteArray>)>> {
        let columns = py.detach(|| joint_columns(&self.0, every_s));
        let columns = columns.map_err(exception)?;
        Ok(columns
            .into_iter()
            .map(|(name, doubles)| (name, PyByteArray::new(py, &doubles)))
            .collect())
    }

    fn joints_csv<'py>(&self, py: Python<'py>, every_s: f64) -> PyResult<Bound<'py, PyBytes>> {
        let mut text = Vec::new();
        let written = py.detach(|| self.0.write_joints_csv(&mut text, every_s));
        written.map_err(exception)?;
        Ok(PyBytes::new(py, &text))
    }

    fn trajectory<'py>(
        &self,
        py: Python<'py>,
        every_s: f64,
        names: Option<Vec<String>>,
        is_yaml: bool,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let mut text = Vec::new();
        let names = names.as_deref();
        let written = py.detach(|| self.0.write_trajectory(&mut text, every_s, names, is_yaml));
        written.map_err(exception)?;
        Ok(PyBytes::new(py, &text))
    }

    fn gcode<'py>(&self, py: Python<'py>, dialect: &str) -> PyResult<Bound<'py, PyBytes>> {
        let mut text = Vec::new();
        let written = py.detach(|| self.0.write_gcode(&mut text, dialect));
        written.map_err(exception)?;
        Ok(PyBytes::new(py, &text))
    }

    fn program(
        &self,
        py: Python<'_>,
        language: &str,
        name: &str,
    ) -> PyResult<Vec<(String, String)>> {
        py.detach(|| self.0.program(language, name))
            .map_err(exception)
    }

    /// The page of `headway view`.
    fn page(&self, py: Python<'_>) -> String {
        py.detach(|| self.0.page())
    }

    /// The figures, and what went wrong if anything did.
    fn simulate(
        &self,
        py: Python<'_>,
        link: &str,
        seed: u64,
        material: Option<&str>,
    ) -> PyResult<(String, Option<String>)> {
        let simulation = py
            .detach(|| match material {
                Some(material) => self.0.simulate_material(link, seed, material),
                None => self.0.simulate(link, seed),
            })
            .map_err(exception)?;
        let problem = simulation.check().err().map(|error| error.to_string());
        Ok((simulation.figures_json(), problem))
    }
}

/// The columns as bytes of doubles in the machine's order.
fn columns(job: &api::Job, every_s: f64) -> Result<[Vec<u8>; 14], Error> {
    let mut columns: [Vec<u8>; 14] = Default::default();
    for pose in job.poses(every_s)? {
        let [x, y, z] = pose.tip_mm;
        let [nx, ny, nz] = pose.tool_axis;
        let row = [
            pose.time_s,
            f64::from(pose.layer),
            pose.pass.map_or(-1.0, f64::from),
            x,
            y,
            z,
            nx,
            ny,
            nz,
            pose.heading_rad,
            pose.speed_mm_s,
            pose.flow_mm3_s,
            state_number(pose.state),
            pose.width_mm.unwrap_or(f64::NAN),
        ];
        for (column, value) in columns.iter_mut().zip(row) {
            column.extend(value.to_ne_bytes());
        }
    }
    Ok(columns)
}

/// The joints' columns, named as in the table of the command.
fn joint_columns(job: &api::Job, every_s: f64) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let joints = job.joints();
    let first = ["t_s", "layer", "pass", "state", "volume_mm3", "flow_mm3_s"];
    let mut names: Vec<String> = first.map(str::to_string).to_vec();
    for ending in ["{unit}", "{unit}_s", "{unit}_s2", "steps"] {
        names.extend(joints.iter().map(|joint| {
            let ending = ending.replace("{unit}", joint.unit);
            format!("{}_{ending}", joint.column)
        }));
    }
    let mut columns = vec![Vec::new(); names.len()];
    for at in job.joint_poses(every_s)? {
        let at = at?;
        let first = [
            at.time_s,
            f64::from(at.layer),
            at.pass.map_or(-1.0, f64::from),
            state_number(at.state),
            at.volume_mm3,
            at.flow_mm3_s,
        ];
        let steps = at.steps.iter().map(|steps| *steps as f64);
        let row = first.into_iter().chain(at.position).chain(at.velocity);
        let row = row.chain(at.acceleration).chain(steps);
        for (column, value) in columns.iter_mut().zip(row) {
            column.extend(value.to_ne_bytes());
        }
    }
    Ok(names.into_iter().zip(columns).collect())
}

#[pymodule]
fn _headway(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("HeadwayError", py.get_type::<HeadwayError>())?;
    module.add("PartError", py.get_type::<PartError>())?;
    module.add("OptionsError", py.get_type::<OptionsError>())?;
    module.add("PlanError", py.get_type::<PlanError>())?;
    module.add("JobError", py.get_type::<JobError>())?;
    module.add_class::<Part>()?;
    module.add_class::<Job>()?;
    module.add_function(wrap_pyfunction!(planning::plan, module)?)?;
    module.add_function(wrap_pyfunction!(planning::plan_shard, module)?)
}
