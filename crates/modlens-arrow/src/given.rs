//! Memory of arrays that were given away, for the next ones.
//!
//! Memory of megabytes that is freed goes back to the system, and each of its pages costs a fault when it comes again. A reader
//! that drops a batch before it asks for the one after the next gets the same memory again.

use std::collections::VecDeque;

use arrow_array::Array;
use arrow_buffer::Buffer;

use crate::values::Item;

/// While an array is made, a reader has the one before. The one before that is free.
const KEPT: usize = 2;

/// The items of the last arrays of a column.
#[derive(Default)]
pub(super) struct GivenItems(VecDeque<Buffer>);

impl GivenItems {
    /// Remembers the items of an array: those of its rows, where these are lists.
    pub(super) fn add(&mut self, array: &dyn Array) {
        let mut data = array.to_data();
        while let Some(items) = data.child_data().first().cloned() {
            data = items;
        }
        self.0.extend(data.buffers().last().cloned());
    }

    /// The memory of items that nobody reads any more, empty.
    pub(super) fn take<T: Item>(&mut self) -> Option<Vec<T>> {
        if self.0.len() < KEPT {
            return None;
        }
        let mut items = T::vector_of(self.0.pop_front()?)?;
        items.clear();
        Some(items)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arrow_array::Int64Array;

    #[test]
    fn only_what_nobody_reads_is_taken() {
        let array = |number: i64| Int64Array::from(vec![number; 1000]);
        let (mut given, first, second) = (GivenItems::default(), array(1), array(2));
        let place = first.values().as_ptr();
        given.add(&first);
        assert!(given.take::<i64>().is_none());
        given.add(&second);
        drop(first);
        let taken = given.take::<i64>().unwrap();
        assert_eq!((taken.as_ptr(), taken.len(), taken.capacity()), (place, 0, 1000));
        given.add(&array(3));
        // The second one is still read.
        assert!(given.take::<i64>().is_none());
        assert!(second.values().iter().all(|&number| number == 2));
    }
}
