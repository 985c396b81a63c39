//! The live tree: which pages are resident, and so what is drawable. Nothing else may call a page drawable.

mod live;

pub use live::LiveTree;
