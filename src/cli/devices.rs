//! `tesserae devices`.
use super::Failure;
/// Arguments of `tesserae devices`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Print JSON
    #[arg(long)]
    json: bool,
}
/// Lists.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    Err(crate::Error::parameter(format!("{:?}", arguments.json)).into())
}
