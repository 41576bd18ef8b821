//! Stores the machine that a board is built for where the library reads it, and passes the linker
//! script and `memory.x` to the linker, for microcontroller binaries only.

use std::path::Path;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=../memory.x");
    include_machine();
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let manifest = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    println!("cargo:rustc-link-search={manifest}/..");
    // Sector 3 is the settings': only the vectors are before it, code begins after it. Before the
    // script, which would place it itself.
    if std::env::var_os("CARGO_FEATURE_OCTOPUS_SERIAL").is_some() {
        for binary in ["octopus", "spider", "spider22"] {
            println!("cargo:rustc-link-arg-bin={binary}=--defsym=_stext=0x08010000");
        }
    }
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    // Segments begin where their sections do. Rounded down to a page, the first one would claim the
    // flash of the boot loader below the image, and a flasher would write it.
    println!("cargo:rustc-link-arg-bins=--nmagic");
    if std::env::var_os("CARGO_FEATURE_DEFMT").is_some() {
        println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    }
    // The emulated binaries live where the emulated machine has its memory.
    for binary in ["qemu", "qemu_bench"] {
        println!("cargo:rustc-link-arg-bin={binary}=--defsym=_mem_qemu=1");
    }
    println!("cargo:rustc-link-arg-bin=boot_loader=--defsym=_mem_whole=1");
}

/// Copies the file that `HEADWAY_MACHINE` names to `machine.bin`; an empty one stands for none.
fn include_machine() {
    println!("cargo:rerun-if-env-changed=HEADWAY_MACHINE");
    let mut machine = Vec::new();
    if let Ok(path) = std::env::var("HEADWAY_MACHINE") {
        println!("cargo:rerun-if-changed={path}");
        match std::fs::read(&path) {
            Ok(bytes) => machine = bytes,
            Err(error) => stop(&format!("HEADWAY_MACHINE={path} cannot be read: {error}")),
        }
    }
    let directory = std::env::var("OUT_DIR").unwrap_or_default();
    let copy = Path::new(&directory).join("machine.bin");
    if let Err(error) = std::fs::write(&copy, machine) {
        stop(&format!("{} cannot be written: {error}", copy.display()));
    }
}

fn stop(message: &str) -> ! {
    eprintln!("{message}");
    std::process::exit(1);
}
