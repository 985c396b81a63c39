//! The newest value from one thread to another. With what the writer fills and what the reader holds, its slot makes a
//! triple buffer: neither side ever waits, and what nobody took is overtaken.

use crossbeam_utils::atomic::AtomicCell;

/// A slot for one boxed value; swapping the pointer is one atomic step.
pub struct Latest<T>(AtomicCell<Option<Box<T>>>);

impl<T> Default for Latest<T> {
    fn default() -> Self {
        Self(AtomicCell::new(None))
    }
}

impl<T> Latest<T> {
    /// Puts a value in; gives back one that nobody took.
    pub fn publish(&self, value: Box<T>) -> Option<Box<T>> {
        self.0.swap(Some(value))
    }

    /// The newest value, once.
    pub fn take(&self) -> Option<Box<T>> {
        self.0.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn the_slot_needs_no_lock() {
        assert!(AtomicCell::<Option<Box<[u64; 100]>>>::is_lock_free());
    }

    #[test]
    fn values_come_in_order_and_the_last_one_always_comes() {
        const LAST: u64 = 100_000;
        let slot = Arc::new(Latest::default());
        let writer = slot.clone();
        let thread = std::thread::Builder::new().spawn(move || {
            (1..=LAST).filter(|&value| writer.publish(Box::new(vec![value; 8])).is_some()).count() as u64
        });
        let (mut seen, mut taken) = (0, 0);
        while seen < LAST {
            if let Some(value) = slot.take() {
                assert!(value.iter().all(|&word| word == value[0]) && value[0] > seen);
                (seen, taken) = (value[0], taken + 1);
            }
            std::hint::spin_loop();
        }
        assert_eq!(thread.unwrap().join().unwrap() + taken, LAST, "each value is taken or given back");
    }
}
