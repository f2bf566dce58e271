//! What goes wrong on a device, and how it comes to be known.
//!
//! CubeCL answers with panics: on a thread of its own, where nobody hears them, and on the caller's. wgpu tells through
//! callbacks what its calls do not. Here all of it becomes a [`Fault`].

use std::any::Any;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook, take_hook};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};
use std::thread;

use cubecl::device::DeviceId;

/// Why a device cannot be trusted any more, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// What was found.
    pub why: String,
    /// What to do about it.
    pub remedy: &'static str,
}

/// For a device that is gone.
const RESET: &str =
    "see the system's log for why its driver was reset (`dmesg`), end other programs that use it, and go on";
/// For memory that ran out.
const SPACE: &str = "end other programs that use it, take fewer particles, or run with --device cpu";
/// For kernels that were refused, or not run.
const DRIVER: &str = "update its driver, or run with --device cpu";

impl Fault {
    /// The device was taken away.
    pub fn lost(why: &str) -> Self {
        Self { why: format!("it was lost: {why}"), remedy: RESET }
    }

    /// Its memory ran out.
    pub fn full(why: &str) -> Self {
        Self { why: format!("its memory ran out: {why}"), remedy: SPACE }
    }

    /// It does not do what it was asked to.
    pub fn refused(why: impl Into<String>) -> Self {
        Self { why: why.into(), remedy: DRIVER }
    }

    /// What wgpu tells.
    pub fn told(error: &wgpu::Error) -> Self {
        match error {
            wgpu::Error::OutOfMemory { .. } => Self::full(&error.to_string()),
            _ => Self::refused(error.to_string()),
        }
    }
}

thread_local! {
    /// Whether the thread is within [`guarded`].
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// The first panic on each of CubeCL's threads, by the thread's name.
fn panics() -> MutexGuard<'static, BTreeMap<String, String>> {
    static PANICS: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());
    // What another thread left when it panicked is whole: a row is put in at once.
    PANICS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// CubeCL's thread for a device is named after it and its stage.
fn is_thread_of(name: &str, device: &DeviceId) -> bool {
    let number = format!("-{}-{}", device.type_id, device.index_id);
    name.strip_prefix("DS").and_then(|rest| rest.strip_suffix(&number)).is_some_and(|stage| stage.len() == 1)
}

/// From now on panics on CubeCL's threads and within [`guarded`] are kept and not printed. All others go where they
/// went.
fn listen() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let others = take_hook();
        set_hook(Box::new(move |panic: &PanicHookInfo<'_>| {
            let thread = thread::current();
            let name = thread.name().unwrap_or_default();
            if name.starts_with("DSD-") || name.starts_with("DSU-") {
                panics().entry(name.to_owned()).or_insert_with(|| message(panic.payload()));
            } else if !GUARDED.get() {
                others(panic);
            }
        }));
    });
}

fn message(payload: &(dyn Any + Send)) -> String {
    let text =
        payload.downcast_ref::<String>().map(String::as_str).or_else(|| payload.downcast_ref().copied());
    text.unwrap_or("it panicked without a word").to_owned()
}

/// Calls into CubeCL; a panic on this thread becomes its message.
pub fn guarded<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    listen();
    let outer = GUARDED.replace(true);
    let result = catch_unwind(AssertUnwindSafe(call));
    GUARDED.set(outer);
    result.map_err(|payload| message(&*payload))
}

/// The first panic on CubeCL's thread for a device.
pub fn panic_of(device: &DeviceId) -> Option<String> {
    panics().iter().find(|(thread, _)| is_thread_of(thread, device)).map(|(_, told)| told.clone())
}

/// An error of CubeCL's in one line: without its headings and its traces.
pub fn plain(error: &dyn std::fmt::Display) -> String {
    let text = error.to_string();
    let lines = text.lines().map(str::trim).take_while(|line| !line.starts_with("Backtrace"));
    lines.filter(|line| !line.is_empty() && *line != "Caused by:").collect::<Vec<_>>().join(": ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_within_becomes_its_message_and_leaves_the_guard() {
        assert_eq!(guarded(|| 7), Ok(7));
        let told = guarded(|| -> u32 { panic!("no room for {} buffers", 3) });
        assert_eq!(told, Err("no room for 3 buffers".to_owned()));
        assert_eq!(guarded(|| -> u32 { panic!("nothing") }), Err("nothing".to_owned()));
        assert!(!GUARDED.get());
    }

    #[test]
    fn panics_on_a_device_s_thread_are_kept_by_device() {
        listen();
        let device = DeviceId::new(99, 7);
        for told in ["the first is the cause", "the second follows"] {
            let thread = thread::Builder::new().name("DSD-99-7".to_owned());
            thread.spawn(move || panic!("{told}")).unwrap().join().unwrap_err();
        }
        assert_eq!(panic_of(&device), Some("the first is the cause".to_owned()));
        assert_eq!(panic_of(&DeviceId::new(9, 7)), None);
        assert_eq!(panic_of(&DeviceId::new(99, 77)), None);
    }

    #[test]
    fn what_wgpu_tells_comes_with_what_to_do() {
        let source = || Box::new(std::io::Error::other("no heap is left"));
        let full = Fault::told(&wgpu::Error::OutOfMemory { source: source() });
        assert!(
            full.why.starts_with("its memory ran out") && full.remedy.contains("fewer particles"),
            "{full:?}"
        );
        let refused = Fault::told(&wgpu::Error::Validation {
            source: source(),
            description: "too many buffers".to_owned(),
        });
        assert!(
            refused.why.contains("too many buffers") && refused.remedy.contains("--device cpu"),
            "{refused:?}"
        );
    }

    #[test]
    fn errors_are_told_in_one_line() {
        let told = "An error happened\nCaused by:\n  the driver is gone\nBacktrace:\n  0: main";
        assert_eq!(plain(&told), "An error happened: the driver is gone");
    }
}
