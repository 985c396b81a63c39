//! The world that a program of this folder works on, as it is named by its arguments.

use std::path::PathBuf;
use std::sync::Arc;
use stoop::store::{CACHE_LIMIT, DiskCache, OpenOptions, World};
use stoop::units::ByteSize;

#[derive(clap::Args)]
pub struct WorldArguments {
    /// Folder or address (http://, https://, s3://) of the world
    world: PathBuf,
    /// Keep what is read of a world behind an address in this folder, and read it there
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// What the cache may take on the disk
    #[arg(long, value_name = "SIZE", default_value_t = CACHE_LIMIT, requires = "cache")]
    cache_limit: ByteSize,
}

impl WorldArguments {
    /// Opens it, and says what is to be noted of it in the name of `program`.
    pub fn open(&self, program: &str) -> anyhow::Result<World> {
        let cache = self.cache.as_deref().map(|folder| DiskCache::open(folder, self.cache_limit)).transpose()?;
        let options = OpenOptions { cache: cache.map(Arc::new), ..OpenOptions::default() };
        let world = World::open_with(&self.world, &options)?;
        world.notice().into_iter().for_each(|notice| eprintln!("{program}: {notice}"));
        Ok(world)
    }
}
