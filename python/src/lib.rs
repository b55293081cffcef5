//! `asra_stream._core`: what the Python module does in Rust. The module's own Python files give it its face.

mod columns;
mod drive;

use std::ffi::OsString;
use std::path::PathBuf;

use asra_stream::PointSource;
use asra_stream::cli;
use asra_stream::{Error, Mesh, Overwrite, PointSlice, Positions, Precision, Reconstruction, Result};
use numpy::{Element, PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::columns::{Columns, Held};
use crate::drive::{drive, raised};

/// The command line of a reconstruction of what has no name.
const NAMELESS: &str = "-";

/// The job that options ask for, which are as the command has them.
fn job(options: Vec<String>) -> Result<asra_stream::internals::run::Job> {
    let nameless = ["--".to_owned(), NAMELESS.to_owned()];
    let arguments = ["asra-stream".to_owned()].into_iter().chain(options).chain(nameless);
    let arguments = cli::parsed(arguments.map(OsString::from))?;
    if arguments.command.is_some() {
        return Err(Error::Usage("these are the options of a subcommand".into()));
    }
    arguments.reconstruct.job()
}

/// A finished mesh. It holds no part of its cloud.
#[pyclass(frozen, module = "asra_stream._core", name = "Mesh")]
struct CoreMesh {
    mesh: Mesh,
}

#[pymethods]
impl CoreMesh {
    /// Vertices as an array (n, 3): `float32` if the points were, else `float64`.
    fn vertices(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        match self.mesh.precision() {
            Precision::Single => array(py, py.detach(|| self.mesh.local_vertices())),
            Precision::Double => array(py, py.detach(|| self.mesh.vertices())),
        }
    }

    /// Vertices less the origin, as an array (n, 3) of `float32`.
    fn local_vertices(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        array(py, py.detach(|| self.mesh.local_vertices()))
    }

    /// Triangles as an array (m, 3) of `uint32`.
    fn triangles(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        array(py, py.detach(|| self.mesh.triangles()))
    }

    /// The names of the attributes.
    fn attribute_names(&self) -> Vec<String> {
        self.mesh.attributes().iter().map(|attribute| attribute.name.clone()).collect()
    }

    /// The type of an attribute, as NumPy names it, and its values as an array of bytes.
    fn attribute<'py>(&self, py: Python<'py>, name: &str) -> PyResult<(&'static str, Bound<'py, PyArray1<u8>>)> {
        let (scalar, bytes) = py.detach(|| self.mesh.attribute_bytes(name)).map_err(|error| raised(py, error))?;
        Ok((columns::numpy_name(scalar), PyArray1::from_vec(py, bytes)))
    }

    #[getter]
    fn origin(&self) -> [f64; 3] {
        self.mesh.origin()
    }

    #[getter]
    fn vertex_count(&self) -> usize {
        self.mesh.vertex_count()
    }

    #[getter]
    fn triangle_count(&self) -> usize {
        self.mesh.triangle_count()
    }

    /// The reference system as JSON.
    fn crs(&self) -> Option<String> {
        self.mesh.crs().map(|crs| serde_json::to_string(crs).unwrap_or_default())
    }

    /// The report as JSON.
    fn report(&self) -> String {
        serde_json::to_string(self.mesh.report()).unwrap_or_default()
    }

    fn save(&self, py: Python<'_>, path: PathBuf, overwrite: bool, coordinates: Option<&str>) -> PyResult<()> {
        let overwrite = if overwrite { Overwrite::Replace } else { Overwrite::Refuse };
        let positions = match coordinates {
            None => None,
            Some("input") => Some(Positions::Absolute),
            Some("local") => Some(Positions::Shifted),
            Some(other) => {
                let words = format!("coordinates: expected \"input\" or \"local\", found {other:?}");
                return Err(raised(py, Error::Usage(words)));
            }
        };
        py.detach(|| self.mesh.save_as(path, overwrite, positions)).map_err(|error| raised(py, error))
    }

    /// The mesh with fewer triangles, as options of the command ask.
    fn simplify(&self, py: Python<'_>, options: Vec<String>, progress: Option<Bound<'_, PyAny>>) -> PyResult<CoreMesh> {
        let asked =
            job(options).and_then(|job| self.mesh.simplification_of(&job)).map_err(|error| raised(py, error))?;
        made(py, progress, |observer| self.mesh.simplify_observed(&asked, observer))
    }

    /// What a strict check finds, as JSON.
    fn check(&self, py: Python<'_>) -> PyResult<String> {
        let report = drive(py, None, |observer| self.mesh.check_observed(observer))?;
        Ok(serde_json::to_string(&report).unwrap_or_default())
    }
}

/// A copy that Python owns.
fn array<T: Element + Copy, const N: usize>(py: Python<'_>, rows: Result<Vec<[T; N]>>) -> PyResult<Py<PyAny>> {
    let rows = rows.map_err(|error| raised(py, error))?;
    let count = rows.len();
    // The allocation is handed over as it is.
    let flat: Vec<T> = rows.into_flattened();
    Ok(PyArray1::from_vec(py, flat).reshape([count, N])?.into_any().unbind())
}

/// Points that come in pieces, kept in temporary storage.
#[pyclass(module = "asra_stream._core")]
struct PointSpool {
    spool: Option<asra_stream::PointSpool>,
    in_memory: u64,
    folder: Option<PathBuf>,
}

#[pymethods]
impl PointSpool {
    #[new]
    fn new(in_memory: u64, folder: Option<PathBuf>) -> PointSpool {
        PointSpool { spool: None, in_memory, folder }
    }

    /// Appends points; the first ones settle precision and attributes.
    fn append(
        &mut self,
        py: Python<'_>,
        xyz: [Bound<'_, PyAny>; 3],
        attributes: Vec<(String, Bound<'_, PyAny>)>,
    ) -> PyResult<()> {
        let held = Held::of(&xyz, &attributes)?;
        let columns = held.columns().map_err(|error| raised(py, error))?;
        let (spool, in_memory, folder) = (&mut self.spool, self.in_memory, self.folder.clone());
        py.detach(|| {
            if spool.is_none() {
                let new = asra_stream::PointSpool::new(columns.precision(), columns.attributes(), in_memory, folder)?;
                *spool = Some(new);
            }
            spool.as_mut().map_or(Ok(()), |spool| spool.append(&columns))
        })
        .map_err(|error| raised(py, error))
    }
}

/// Reconstructs from points in memory: an array (n, 3) whose rows lie one after the other.
#[pyfunction]
fn reconstruct_rows(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    attributes: Vec<(String, Bound<'_, PyAny>)>,
    options: Vec<String>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<CoreMesh> {
    if let Ok(points) = points.extract::<PyReadonlyArray2<'_, f32>>() {
        let slice = rows(points.as_slice()?)?;
        return of_rows(py, PointSlice::Single(slice), attributes, options, progress);
    }
    let points = points.extract::<PyReadonlyArray2<'_, f64>>()?;
    let slice = rows(points.as_slice()?)?;
    of_rows(py, PointSlice::Double(slice), attributes, options, progress)
}

fn rows<T>(numbers: &[T]) -> PyResult<&[[T; 3]]> {
    let (rows, rest) = numbers.as_chunks::<3>();
    if rest.is_empty() { Ok(rows) } else { Err(PyValueError::new_err("points: expected an array of shape (n, 3)")) }
}

fn of_rows(
    py: Python<'_>,
    points: PointSlice<'_>,
    attributes: Vec<(String, Bound<'_, PyAny>)>,
    options: Vec<String>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<CoreMesh> {
    let job = job(options).map_err(|error| raised(py, error))?;
    let held = Held::of_attributes(&attributes)?;
    let columns = held.attribute_columns();
    let rows = columns::Rows::new(points, &columns).map_err(|error| raised(py, error))?;
    if columns.is_empty() {
        return made(py, progress, |observer| Reconstruction::of(points).job(job).observer(observer).run());
    }
    made(py, progress, |observer| Reconstruction::from_source(&rows).job(job).observer(observer).run())
}

/// Reconstructs from points in memory: three arrays of coordinates, in whatever steps they lie.
#[pyfunction]
fn reconstruct_columns(
    py: Python<'_>,
    xyz: [Bound<'_, PyAny>; 3],
    attributes: Vec<(String, Bound<'_, PyAny>)>,
    options: Vec<String>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<CoreMesh> {
    let job = job(options).map_err(|error| raised(py, error))?;
    let held = Held::of(&xyz, &attributes)?;
    let columns: Columns<'_> = held.columns().map_err(|error| raised(py, error))?;
    made(py, progress, |observer| Reconstruction::from_source(&columns).job(job).observer(observer).run())
}

/// Reconstructs from files, patterns and folders.
#[pyfunction]
fn reconstruct_files(
    py: Python<'_>,
    inputs: Vec<PathBuf>,
    options: Vec<String>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<CoreMesh> {
    let job = job(options).map_err(|error| raised(py, error))?;
    made(py, progress, |observer| Reconstruction::from_files(inputs).job(job).observer(observer).run())
}

/// Reconstructs from points in temporary storage.
#[pyfunction]
fn reconstruct_spool(
    py: Python<'_>,
    spool: &PointSpool,
    options: Vec<String>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<CoreMesh> {
    let job = job(options).map_err(|error| raised(py, error))?;
    let Some(points) = &spool.spool else {
        return Err(raised(py, Error::NoPoints { dropped: 0, filtered: 0 }));
    };
    made(py, progress, |observer| Reconstruction::from_source(points).job(job).observer(observer).run())
}

fn made(
    py: Python<'_>,
    progress: Option<Bound<'_, PyAny>>,
    work: impl FnOnce(&drive::Watch) -> Result<Mesh> + Send,
) -> PyResult<CoreMesh> {
    Ok(CoreMesh { mesh: drive(py, progress.as_ref(), work)? })
}

/// Does what a command line asks for, and gives its findings as JSON.
#[pyfunction]
fn execute(py: Python<'_>, arguments: Vec<OsString>, progress: Option<Bound<'_, PyAny>>) -> PyResult<String> {
    let arguments = cli::parsed(arguments).map_err(|error| raised(py, error))?;
    let value = drive(py, progress.as_ref(), |observer| cli::outcome(&arguments, Some(observer)))?;
    Ok(value.to_string())
}

/// The command: does what the arguments say, prints, and gives the exit code.
#[pyfunction]
fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| cli::run(arguments))
}

/// What the Python files of `asra_stream` are made on.
#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<CoreMesh>()?;
    module.add_class::<PointSpool>()?;
    module.add_function(wrap_pyfunction!(reconstruct_rows, module)?)?;
    module.add_function(wrap_pyfunction!(reconstruct_columns, module)?)?;
    module.add_function(wrap_pyfunction!(reconstruct_files, module)?)?;
    module.add_function(wrap_pyfunction!(reconstruct_spool, module)?)?;
    module.add_function(wrap_pyfunction!(execute, module)?)?;
    module.add_function(wrap_pyfunction!(command, module)?)?;
    Ok(())
}
