//! The `tesserae` command: everything is in [`tesserae_cli`].

fn main() -> std::process::ExitCode {
    tesserae_cli::main()
}
