//! Models: read once, then shared by any number of streams and threads.

use std::collections::BTreeMap;
use std::ffi::{c_char, CStr, CString};
use std::fmt::Display;
use std::path::PathBuf;
use std::ptr::null;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use granular_id::model::{ModelError, ModelFileError, MAX_FILE_BYTES};
use granular_id::{Error, Model};
use serde_json::Value;

use crate::gid_status::{GID_FILE, GID_HANDLE, GID_MEMORY, GID_MODEL, GID_OK, GID_SIZE};
use crate::last_error::failed;
use crate::{check_pointer, gid_status, guarded, slice, write};

/// A model that was loaded. Number 0 is never one.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gid_model {
    /// Its number.
    pub id: u64,
}

/// What recordings a model is for, and what it names.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gid_model_info {
    /// Labels: K.
    pub n_classes: usize,
    /// Values of a row.
    pub n_axes: usize,
    /// Rows of a window.
    pub n_samples: usize,
    /// Rows in a second.
    pub rate_hz: f64,
    /// Seconds of rest before the onset with which each recording of the training begins; NaN where they do not say, or
    /// differ. A window begins with the rows of this rest.
    pub lead_s: f64,
    /// Whether simulated recordings trained it: its answers say nothing about real materials.
    pub synthetic: bool,
}

/// A model with what is requested over and over.
pub(crate) struct Loaded {
    pub(crate) model: Arc<Model>,
    /// What losses are divided by for probabilities; `None` where none were held out.
    pub(crate) temperature: Option<f64>,
    synthetic: bool,
    labels: Vec<CString>,
    axes: Vec<CString>,
    units: Vec<CString>,
}

impl Loaded {
    fn new(model: Model) -> Self {
        let trained: Value = serde_json::from_str(&model.metadata().trained).unwrap_or_default();
        // Names of a model are printable: none has a zero.
        let texts = |names: &[String]| {
            names.iter().map(|name| CString::new(&name[..]).unwrap_or_default()).collect::<Vec<_>>()
        };
        Self {
            temperature: trained["temperature"].as_f64().filter(|temperature| *temperature > 0.0),
            synthetic: trained["synthetic"].as_bool().unwrap_or_default(),
            labels: texts(model.classes()),
            axes: texts(&model.metadata().axes),
            units: texts(&model.metadata().units),
            model: Arc::new(model),
        }
    }
}

/// The models by their numbers, and how many there have been.
static MODELS: Mutex<(BTreeMap<u64, Arc<Loaded>>, u64)> = Mutex::new((BTreeMap::new(), 0));

fn models() -> MutexGuard<'static, (BTreeMap<u64, Arc<Loaded>>, u64)> {
    MODELS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The model of a handle.
pub(crate) fn loaded(model: gid_model) -> Result<Arc<Loaded>, gid_status> {
    let found = models().0.get(&model.id).cloned();
    found.ok_or_else(|| unknown(model))
}

fn unknown(model: gid_model) -> gid_status {
    failed(GID_HANDLE, format_args!("model {} was freed or never loaded", model.id))
}

unsafe fn enter(model: Model, out: *mut gid_model) -> Result<gid_status, gid_status> {
    let (loaded, mut models) = (Arc::new(Loaded::new(model)), models());
    models.1 += 1;
    let id = models.1;
    models.0.insert(id, loaded);
    // SAFETY: as of the caller.
    unsafe { write(out, "model", gid_model { id }) }
}

/// Stores the sentence of an error of a model, behind where it came from, and gives its status.
fn no_model(error: &ModelError, origin: impl Display) -> gid_status {
    match error {
        ModelError::Spec(Error::Memory { .. }) => failed(GID_MEMORY, format_args!("{origin}{error}")),
        // The core's sentence offers to raise the limit, which C cannot.
        ModelError::FileSize { bytes, max } => {
            failed(GID_MODEL, format_args!("{origin}the file has {bytes} bytes; at most {max} are read"))
        }
        _ => failed(GID_MODEL, format_args!("{origin}{error}")),
    }
}

/// Reads a model from a file of at most 32 MiB, as `Identifier.save` writes it. `path` is a zero-terminated string: UTF-8 on
/// Windows, any bytes elsewhere.
#[no_mangle]
pub unsafe extern "C" fn gid_model_load(path: *const c_char, model: *mut gid_model) -> gid_status {
    guarded(|| {
        check_pointer(path, "path")?;
        check_pointer(model, "model")?;
        // SAFETY: the caller promises a terminated string.
        let path = path_of(unsafe { CStr::from_ptr(path) })?;
        let read = Model::read(path).map_err(|error| match &error {
            ModelFileError::NoModel { path, source } => {
                no_model(source, format_args!("{}: ", path.display()))
            }
            _ => failed(GID_FILE, format_args!("{error}")),
        })?;
        // SAFETY: as of the caller.
        unsafe { enter(read, model) }
    })
}

#[cfg(unix)]
#[allow(clippy::unnecessary_wraps)] // as elsewhere
fn path_of(path: &CStr) -> Result<PathBuf, gid_status> {
    use std::os::unix::ffi::OsStrExt;
    Ok(PathBuf::from(std::ffi::OsStr::from_bytes(path.to_bytes())))
}

#[cfg(not(unix))]
fn path_of(path: &CStr) -> Result<PathBuf, gid_status> {
    let text = path.to_str();
    text.map(PathBuf::from).map_err(|_| failed(GID_FILE, format_args!("path must be UTF-8")))
}

/// Reads a model from the `n` bytes of a file, at most 32 MiB.
#[no_mangle]
pub unsafe extern "C" fn gid_model_load_bytes(
    bytes: *const u8,
    n: usize,
    model: *mut gid_model,
) -> gid_status {
    guarded(|| {
        check_pointer(model, "model")?;
        // SAFETY: as the header says.
        let bytes = unsafe { slice(bytes, n, "bytes") }?;
        let read = Model::from_bytes(bytes, MAX_FILE_BYTES).map_err(|error| no_model(&error, ""))?;
        // SAFETY: as of the caller.
        unsafe { enter(read, model) }
    })
}

/// Frees a model and its strings. Streams made with it go on.
#[no_mangle]
pub extern "C" fn gid_model_free(model: gid_model) -> gid_status {
    guarded(|| {
        let freed = models().0.remove(&model.id);
        freed.map(|_| GID_OK).ok_or_else(|| unknown(model))
    })
}

/// What recordings a model is for, and how many labels it has.
#[no_mangle]
pub unsafe extern "C" fn gid_model_get_info(model: gid_model, info: *mut gid_model_info) -> gid_status {
    guarded(|| {
        let Loaded { model, synthetic, .. } = &*loaded(model)?;
        let found = gid_model_info {
            n_classes: model.classes().len(),
            n_axes: model.n_axes(),
            n_samples: model.n_samples(),
            rate_hz: model.rate_hz(),
            lead_s: model.metadata().lead_s.unwrap_or(f64::NAN),
            synthetic: *synthetic,
        };
        // SAFETY: as the header says.
        unsafe { write(info, "info", found) }
    })
}

/// Label `k`, UTF-8, until the model is freed. Null on an error. Not for a real-time loop: it takes a lock.
#[no_mangle]
pub extern "C" fn gid_model_label(model: gid_model, k: usize) -> *const c_char {
    text_of(model, k, "label", |loaded| &loaded.labels)
}

/// Name of axis `k`, likewise.
#[no_mangle]
pub extern "C" fn gid_model_axis(model: gid_model, k: usize) -> *const c_char {
    text_of(model, k, "axis", |loaded| &loaded.axes)
}

/// Unit of axis `k`, likewise; empty where the training did not know it.
#[no_mangle]
pub extern "C" fn gid_model_unit(model: gid_model, k: usize) -> *const c_char {
    text_of(model, k, "axis", |loaded| &loaded.units)
}

fn text_of(model: gid_model, k: usize, what: &str, texts: fn(&Loaded) -> &[CString]) -> *const c_char {
    let mut found = null();
    guarded(|| {
        let loaded = loaded(model)?;
        let texts = texts(&loaded);
        let text = texts.get(k).ok_or_else(|| {
            failed(GID_SIZE, format_args!("{what} {k} is not one of 0 to {}", texts.len() - 1))
        })?;
        found = text.as_ptr();
        Ok(GID_OK)
    });
    found
}
