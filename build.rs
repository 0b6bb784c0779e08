//! Tells the program what it was built with, for the manifests of its results.

use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let variable = |name: &str| std::env::var(name).unwrap_or_default();
    let version = Command::new(variable("RUSTC")).arg("--version").output();
    let version = version.map_or(String::new(), |o| String::from_utf8_lossy(&o.stdout).into());
    println!("cargo:rustc-env=ARMPOSE_RUSTC={}", version.trim());
    println!("cargo:rustc-env=ARMPOSE_TARGET={}", variable("TARGET"));
}
