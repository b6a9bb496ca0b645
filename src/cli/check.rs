//! x
/// x
#[derive(Debug, clap::Args)]
pub struct CheckArgs {}
/// x
pub fn run(_: &CheckArgs) -> anyhow::Result<()> {
    Ok(())
}
