//! Takes the page of `--web` along, where `MODLENS_PAGE` names it. It is made by Python, after the core was compiled for it.

use std::path::PathBuf;

fn main() {
    println!("cargo:rerun-if-env-changed=MODLENS_PAGE");
    let target = PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo sets it")).join("page.html");
    let Some(page) = std::env::var_os("MODLENS_PAGE") else {
        std::fs::write(target, "").expect("a folder that can be written");
        return;
    };
    println!("cargo:rerun-if-changed={}", page.to_string_lossy());
    std::fs::copy(page, target).expect("MODLENS_PAGE names a file");
}
