//! The `tesserae` command: everything is in [`tesserae::cli`].

fn main() -> std::process::ExitCode {
    tesserae::cli::main()
}
