//! The `tesserae` command: everything is in [`tesserae_mesh::cli`].

fn main() -> std::process::ExitCode {
    tesserae_mesh::cli::main()
}
