//! x
/// x
#[derive(Debug, clap::Args)]
pub struct RenderArgs {}
/// x
pub fn run(_: &RenderArgs) -> anyhow::Result<()> {
    Ok(())
}
