//! `tesserae serve`.
use super::Failure;
use super::device::DeviceArguments;
/// Arguments of `tesserae serve`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    device: DeviceArguments,
}
/// Serves.
pub fn run(arguments: Arguments) -> Result<(), Failure> {
    Err(crate::Error::parameter(format!("{:?}", arguments.device.contradiction())).into())
}
