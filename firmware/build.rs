//! Hands the linker script and `memory.x` to the linker, for binaries of a microcontroller only.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=../memory.x");
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let manifest = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    println!("cargo:rustc-link-search={manifest}/..");
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    // The emulated binaries live where the emulated machine has its memory.
    for binary in ["qemu", "qemu_bench"] {
        println!("cargo:rustc-link-arg-bin={binary}=--defsym=_mem_qemu=1");
    }
}
