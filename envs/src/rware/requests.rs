//! The queue of requested shelves, and the draw after a delivery (rware §5.5).

use rand::RngCore;

use crate::draw::below;

/// Distinct shelf ids in slots, never all shelves there are.
#[derive(Debug, Clone)]
pub(crate) struct Requests {
    queue: Vec<u16>,
    /// By shelf id; id 0 is never requested.
    requested: Vec<bool>,
}

impl Requests {
    /// Shelves `1..=length`, for the start.
    pub fn new(length: u16, shelves: usize) -> Requests {
        let mut requests = Requests { queue: Vec::new(), requested: vec![false; shelves + 1] };
        requests.set(&Vec::from_iter(1..=length));
        requests
    }

    /// The ids in slot order.
    pub fn queue(&self) -> &[u16] {
        &self.queue
    }

    pub fn contains(&self, id: u16) -> bool {
        self.requested[usize::from(id)]
    }

    /// Distinct ids of shelves there are.
    pub fn set(&mut self, queue: &[u16]) {
        self.requested.fill(false);
        self.queue.clear();
        self.queue.extend_from_slice(queue);
        for &id in queue {
            self.requested[usize::from(id)] = true;
        }
    }

    /// Requests the same number of new shelves; every choice is equally likely.
    pub fn redraw_all(&mut self, rng: &mut dyn RngCore) {
        self.requested.fill(false);
        let shelves = self.requested.len() as u32 - 1;
        for slot in &mut self.queue {
            *slot = loop {
                let id = 1 + below(rng, shelves) as u16;
                if !self.requested[usize::from(id)] {
                    break id;
                }
            };
            self.requested[usize::from(*slot)] = true;
        }
    }

    /// All shelves that are not requested, in the order of their ids; at least one.
    pub fn unrequested(&self) -> impl Iterator<Item = u16> + '_ {
        (1..).zip(&self.requested[1..]).filter(|(_, &requested)| !requested).map(|(id, _)| id)
    }

    /// A uniformly random shelf that is not requested.
    pub fn draw(&self, rng: &mut dyn RngCore) -> u16 {
        let count = self.requested.len() - 1 - self.queue.len();
        let choice = below(rng, count as u32) as usize;
        self.unrequested().nth(choice).expect("there are that many")
    }

    /// Puts `new`, which is unrequested, into the slot of `old`, which is requested.
    pub fn replace(&mut self, old: u16, new: u16) {
        debug_assert!(self.contains(old) && !self.contains(new));
        for slot in self.queue.iter_mut().filter(|slot| **slot == old) {
            *slot = new;
        }
        self.requested[usize::from(old)] = false;
        self.requested[usize::from(new)] = true;
    }
}
