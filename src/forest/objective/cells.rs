//! The samples of a node in the order of a feature's bins.
//!
//! Samples of one target that fall into the same bin are one [`Cell`]. The samples of an image
//! stand together, so that it is enough to remember the last cell of each bin; in nodes of more
//! than a few samples there are less than half as many cells as samples.

use super::super::bins::BINS;
use crate::forest::grow::Member;

/// Marks the last cell of a bin; places are below.
const LAST: usize = 1 << 16;

/// The samples of one target in one bin.
///
/// One number: whether it is the last of its bin, the place of the target among those present in
/// the node, 8 bits of the bin, and 32 of the weight.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cell(u64);

impl Cell {
    #[inline(always)]
    fn new(place: u16, bin: u8, weight: u32) -> Self {
        Self(u64::from(place) << 40 | u64::from(bin) << 32 | u64::from(weight))
    }

    #[inline(always)]
    pub fn place(self) -> usize {
        (self.0 >> 40) as usize % LAST
    }

    #[inline(always)]
    pub fn is_last(self) -> bool {
        self.0 >> 40 >= LAST as u64
    }

    #[inline(always)]
    fn bin(self) -> usize {
        (self.0 >> 32) as usize % BINS
    }

    #[inline(always)]
    pub fn weight(self) -> u32 {
        self.0 as u32
    }
}

/// The targets that are present in a node, in the order of their first samples.
#[derive(Debug, Clone)]
pub struct Present {
    /// The place of each target; meaningless unless the target of that place is the same.
    place_of: Vec<u16>,
    targets: Vec<u16>,
    weights: Vec<u32>,
}

impl Present {
    pub fn new(targets: usize) -> Self {
        Self {
            place_of: vec![0; targets],
            targets: Vec::new(),
            weights: Vec::new(),
        }
    }

    /// A new node.
    pub fn enter(&mut self, members: &[Member]) {
        self.targets.clear();
        self.weights.clear();
        for member in members {
            let place = &mut self.place_of[usize::from(member.target)];
            if self.targets.get(usize::from(*place)) != Some(&member.target) {
                *place = self.targets.len() as u16;
                self.targets.push(member.target);
                self.weights.push(0);
            }
            self.weights[usize::from(*place)] += u32::from(member.weight);
        }
    }

    pub fn targets(&self) -> &[u16] {
        &self.targets
    }

    /// By place.
    pub fn weights(&self) -> &[u32] {
        &self.weights
    }

    #[inline(always)]
    fn place(&self, target: u16) -> u16 {
        self.place_of[usize::from(target)]
    }
}

/// The cells of one feature at one node, by bin. Memory is kept from feature to feature.
#[derive(Debug, Clone)]
pub struct Cells {
    /// Each member of the node as a cell of its own in bin 0.
    members: Vec<Cell>,
    /// The last cell of each bin so far; between calls empty.
    last: [Cell; BINS],
    /// The cells before the last, in the order in which they were found to be complete.
    complete: Vec<Cell>,
    /// How many of them there are in each bin; then, where the next one belongs.
    counts: [u32; BINS],
    sorted: Vec<Cell>,
    occupied: Vec<u8>,
    /// How many cells there are.
    count: usize,
}

impl Default for Cells {
    fn default() -> Self {
        Self {
            members: Vec::new(),
            last: [Cell::default(); BINS],
            complete: Vec::new(),
            counts: [0; BINS],
            sorted: Vec::new(),
            occupied: Vec::new(),
            count: 0,
        }
    }
}

impl Cells {
    /// A new node.
    pub fn enter(&mut self, present: &Present, members: &[Member]) {
        self.members.clear();
        let cell = |m: &Member| Cell::new(present.place(m.target), 0, u32::from(m.weight));
        self.members.extend(members.iter().map(cell));
        let most = self.sorted.len().max(members.len() + AT_ONCE);
        self.complete.resize(most, Cell::default());
        self.sorted.resize(most, Cell::default());
    }

    /// Sorts the node's samples by the bins of a feature.
    #[inline(always)]
    pub fn sort(&mut self, codes: &[u8]) {
        let Self {
            members,
            last,
            complete,
            counts,
            sorted,
            occupied,
            ..
        } = self;
        let (complete, sorted) = (&mut complete[..], &mut sorted[..]);
        *counts = [0; BINS];
        let mut count = 0;
        for (member, &code) in members.iter().zip(codes) {
            // Without branches: which way they go is hard to guess.
            let cell = Cell(member.0 | u64::from(code) << 32);
            let before = last[usize::from(code)];
            let same = (cell.0 ^ before.0) >> 32 == 0;
            last[usize::from(code)] = Cell(cell.0 + if same { before.0 as u32 as u64 } else { 0 });
            let is_complete = !same & (before.weight() > 0);
            complete[count] = before;
            count += usize::from(is_complete);
        }
        for &cell in &complete[..count] {
            counts[cell.bin()] += 1;
        }
        occupied.clear();
        let mut end = 0;
        let any = last.map(|cell| u8::from(cell.weight() > 0));
        for (word, mut bits) in bits(&any).into_iter().enumerate() {
            while bits != 0 {
                let bin = 64 * word + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                sorted[end as usize] = std::mem::take(&mut last[bin]);
                let next = end + 1;
                end = next + std::mem::replace(&mut counts[bin], next);
                occupied.push(bin as u8);
            }
        }
        for &cell in &complete[..count] {
            let next = &mut counts[cell.bin()];
            sorted[*next as usize] = cell;
            *next += 1;
        }
        for &bin in &occupied[..] {
            sorted[counts[usize::from(bin)] as usize - 1].0 |= (LAST as u64) << 40;
        }
        sorted[end as usize..][..AT_ONCE].fill(Cell::default());
        self.count = end as usize;
    }

    /// The cells by bin, ascending, [`AT_ONCE`] at once; the last are filled up with cells without
    /// weight.
    #[inline(always)]
    pub fn sorted(&self) -> &[[Cell; AT_ONCE]] {
        &self.sorted.as_chunks().0[..self.count.div_ceil(AT_ONCE)]
    }

    /// The bins with a cell, ascending.
    #[inline(always)]
    pub fn occupied(&self) -> &[u8] {
        &self.occupied
    }
}

/// How many cells are dealt with at once.
pub const AT_ONCE: usize = 4;

/// One bit for each byte that is 1.
#[inline(always)]
pub fn bits(bytes: &[u8; BINS]) -> [u64; BINS / 64] {
    let (words, _) = bytes.as_chunks::<64>();
    std::array::from_fn(|word| {
        let (eights, _) = words[word].as_chunks::<8>();
        eights.iter().enumerate().fold(0, |bits, (i, &eight)| {
            // Each byte's lowest bit is moved to a place of its own in the highest byte.
            let high = u64::from_le_bytes(eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
            bits | high << (8 * i)
        })
    })
}
