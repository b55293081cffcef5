//! A queue of vertices, the cheapest first, in which each stands once.

/// Not in the queue.
const OUT: u32 = u32::MAX;

/// A heap with four children a node. Equal costs go by a key of the vertex that says nothing about where it lies: vertices in order would make fans along rows.
#[derive(Debug, Default)]
pub(super) struct Queue {
    heap: Vec<(f32, u32)>,
    /// Of each vertex: its place in the heap.
    places: Vec<u32>,
    keys: Vec<u32>,
}

impl Queue {
    /// Bytes for each vertex.
    pub(super) const BYTES: u64 = 16;

    /// An empty queue for as many vertices as there are keys.
    pub(super) fn new(keys: Vec<u32>) -> Queue {
        Queue { heap: Vec::with_capacity(keys.len()), places: vec![OUT; keys.len()], keys }
    }

    /// Whether a vertex stands in the queue.
    pub(super) fn has(&self, vertex: u32) -> bool {
        self.places[vertex as usize] != OUT
    }

    /// Puts a vertex in, or elsewhere. The cost must be a number.
    pub(super) fn put(&mut self, vertex: u32, cost: f32) {
        let at = match self.places[vertex as usize] {
            OUT => {
                self.heap.push((cost, vertex));
                self.heap.len() - 1
            }
            at => at as usize,
        };
        self.heap[at] = (cost, vertex);
        let at = self.rise(at);
        self.sink(at);
    }

    /// Takes a vertex out, if it is in.
    pub(super) fn remove(&mut self, vertex: u32) {
        let at = self.places[vertex as usize];
        if at == OUT {
            return;
        }
        self.places[vertex as usize] = OUT;
        let last = self.heap.pop().expect("a vertex stands in it");
        if last.1 != vertex {
            self.heap[at as usize] = last;
            let at = self.rise(at as usize);
            self.sink(at);
        }
    }

    /// Takes out the vertex that costs least.
    pub(super) fn pop(&mut self) -> Option<(f32, u32)> {
        let first = *self.heap.first()?;
        self.remove(first.1);
        Some(first)
    }

    fn before(&self, a: (f32, u32), b: (f32, u32)) -> bool {
        let key = |v: u32| (self.keys[v as usize], v);
        a.0 < b.0 || a.0 == b.0 && key(a.1) < key(b.1)
    }

    fn rise(&mut self, mut at: usize) -> usize {
        let own = self.heap[at];
        while at > 0 {
            let parent = (at - 1) / 4;
            if !self.before(own, self.heap[parent]) {
                break;
            }
            self.set(at, self.heap[parent]);
            at = parent;
        }
        self.set(at, own);
        at
    }

    fn sink(&mut self, mut at: usize) {
        let own = self.heap[at];
        loop {
            let children = 4 * at + 1..(4 * at + 5).min(self.heap.len());
            let Some(least) = children.reduce(|a, b| if self.before(self.heap[b], self.heap[a]) { b } else { a })
            else {
                break;
            };
            if !self.before(self.heap[least], own) {
                break;
            }
            self.set(at, self.heap[least]);
            at = least;
        }
        self.set(at, own);
    }

    fn set(&mut self, at: usize, entry: (f32, u32)) {
        self.heap[at] = entry;
        self.places[entry.1 as usize] = at as u32;
    }
}
