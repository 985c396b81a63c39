//! Right-triangulated irregular networks over 65 × 65 posts (Evans, Kirkpatrick, Townsend 2001).
//!
//! The square of posts is halved along its [`Diagonal`] into two right isosceles triangles; a triangle is split at the
//! middle of its hypotenuse into two of half its area, down to legs of one interval. Triangles have heap numbers
//! ([`Triangle`]): the roots are 2 and 3, the children of `i` are `2i` and `2i + 1`, and there are 13 levels, so all
//! numbers are below [`TRIANGLE_COUNT`].
//!
//! A network is told by its set of posts ([`Active`]): a triangle is split where the middle of its hypotenuse is
//! active. A set stands for a conforming network when it is *closed*: a post needs the right-angled corners of the
//! (at most two) triangles that it splits.

use crate::forest::CellId;
use std::sync::LazyLock;

/// Intervals along a side.
pub const SIDE: usize = 64;
/// Posts in a page.
pub const POST_COUNT: usize = (SIDE + 1) * (SIDE + 1);
/// Splits from a root to the smallest triangles.
pub const DEPTH: u32 = 12;
/// Heap numbers of triangles are below this.
pub const TRIANGLE_COUNT: usize = 2 << (DEPTH + 1);

const LAST: u8 = SIDE as u8;

/// Column from the west and row from the south, 0 to 64.
pub type Post = (u8, u8);

/// The posts that every network has.
pub const CORNERS: [Post; 4] = [(0, 0), (LAST, 0), (0, LAST), (LAST, LAST)];

/// Which way the diagonal of the two root triangles runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Diagonal {
    /// From the south-west corner to the north-east one.
    Rising,
    /// From the north-west corner to the south-east one.
    Falling,
}

impl Diagonal {
    /// The diagonal that makes a child's bintree a part of its parent's: it runs through the parent's centre. A child
    /// that spans its parent's width, where a row is thinned, has no such diagonal and takes the rising one.
    pub fn of(cell: CellId) -> Self {
        let (Some(quadrant), Some(parent)) = (cell.quadrant(), cell.parent()) else {
            return Self::Rising;
        };
        if quadrant.is_north() == quadrant.is_east() || parent.child_row_is_thinned(quadrant.is_north()) {
            Self::Rising
        } else {
            Self::Falling
        }
    }

    /// Turns a post of the rising square into this one's: a quarter turn keeps the sense of rotation.
    fn turn(self, (column, row): Post) -> Post {
        match self {
            Self::Rising => (column, row),
            Self::Falling => (LAST - row, column),
        }
    }

    fn tables(self) -> &'static Tables {
        match self {
            Self::Rising => &RISING,
            Self::Falling => &FALLING,
        }
    }
}

/// A triangle of the bintree by its heap number: 2 and 3 are the roots, the children of `i` are `2i` and `2i + 1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Triangle(u16);

impl Triangle {
    pub const ROOTS: [Self; 2] = [Self(2), Self(3)];

    /// `None` unless 2 ≤ `index` < [`TRIANGLE_COUNT`].
    pub fn new(index: usize) -> Option<Self> {
        (2..TRIANGLE_COUNT).contains(&index).then_some(Self(index as u16))
    }

    pub fn all() -> impl DoubleEndedIterator<Item = Self> {
        (2..TRIANGLE_COUNT as u16).map(Self)
    }

    pub fn index(self) -> usize {
        usize::from(self.0)
    }

    /// 0 for roots to [`DEPTH`].
    pub fn depth(self) -> u32 {
        self.0.ilog2() - 1
    }

    pub fn parent(self) -> Option<Self> {
        (self.0 > 3).then_some(Self(self.0 / 2))
    }

    /// The halves at the hypotenuse's start and at its end; `None` for the smallest.
    pub fn children(self) -> Option<[Self; 2]> {
        (self.depth() < DEPTH).then_some([Self(self.0 * 2), Self(self.0 * 2 + 1)])
    }

    /// Start and end of the hypotenuse, then the right-angled corner; counter-clockwise from above.
    pub fn vertices(self, diagonal: Diagonal) -> [Post; 3] {
        diagonal.tables().vertices[self.index()]
    }

    /// The post that splits it, the middle of its hypotenuse; `None` for the smallest.
    pub fn split_post(self, diagonal: Diagonal) -> Option<Post> {
        let [a, b, _] = self.vertices(diagonal);
        (self.depth() < DEPTH).then(|| middle(a, b))
    }

    /// The child that holds a point of this triangle.
    fn child_at(self, diagonal: Diagonal, column: f64, row: f64) -> Option<Self> {
        let [near_start, near_end] = self.children()?;
        let [a, b, _] = self.vertices(diagonal);
        let [(ax, ay), (bx, by)] = [a, b].map(|(x, y)| (f64::from(x), f64::from(y)));
        let along = (column - (ax + bx) / 2.0) * (bx - ax) + (row - (ay + by) / 2.0) * (by - ay);
        Some(if along < 0.0 { near_start } else { near_end })
    }

    fn root_at(diagonal: Diagonal, column: f64, row: f64) -> Self {
        let south_east = match diagonal {
            Diagonal::Rising => row <= column,
            // Root 2 lies left of its hypotenuse, which runs from the north-west to the south-east.
            Diagonal::Falling => row + column >= SIDE as f64,
        };
        Self::ROOTS[usize::from(!south_east)]
    }

    /// The triangles that hold a point, from a root to the smallest; column and row in 0 to 64.
    pub fn lineage(diagonal: Diagonal, column: f64, row: f64) -> [Self; DEPTH as usize + 1] {
        let mut at = Self::root_at(diagonal, column, row);
        std::array::from_fn(|_| {
            let here = at;
            at = at.child_at(diagonal, column, row).unwrap_or(at);
            here
        })
    }

    /// The triangle of a network that holds a point (column and row in 0 to 64); `is_active` tells the network's posts.
    pub fn find(diagonal: Diagonal, column: f64, row: f64, is_active: impl Fn(Post) -> bool) -> Self {
        let mut at = Self::root_at(diagonal, column, row);
        while at.split_post(diagonal).is_some_and(&is_active) {
            match at.child_at(diagonal, column, row) {
                Some(child) => at = child,
                None => break,
            }
        }
        at
    }
}

fn middle(a: Post, b: Post) -> Post {
    ((a.0 + b.0) / 2, (a.1 + b.1) / 2)
}

/// A post that splits triangles, with what it hangs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Split {
    pub post: Post,
    /// The ends of the hypotenuse that it halves: the height that it replaces is their mean.
    pub ends: [Post; 2],
    /// The right-angled corners of the triangles that it splits; on the border the same one twice.
    pub needs: [Post; 2],
}

struct Tables {
    vertices: Vec<[Post; 3]>,
    splits: Vec<Split>,
}

static RISING: LazyLock<Tables> = LazyLock::new(|| Tables::new(Diagonal::Rising));
static FALLING: LazyLock<Tables> = LazyLock::new(|| Tables::new(Diagonal::Falling));

impl Tables {
    fn new(diagonal: Diagonal) -> Self {
        let [south_west, south_east, north_west, north_east] = CORNERS.map(|corner| diagonal.turn(corner));
        let mut vertices = vec![[south_west; 3]; TRIANGLE_COUNT];
        vertices[2] = [north_east, south_west, south_east];
        vertices[3] = [south_west, north_east, north_west];
        for index in 2..TRIANGLE_COUNT / 2 {
            let [a, b, c] = vertices[index];
            let m = middle(a, b);
            vertices[2 * index] = [c, a, m];
            vertices[2 * index + 1] = [b, c, m];
        }
        let splits = Self::splits(&vertices);
        Self { vertices, splits }
    }

    fn splits(vertices: &[[Post; 3]]) -> Vec<Split> {
        let mut splits: Vec<Split> = Vec::with_capacity(POST_COUNT - CORNERS.len());
        let mut seen = vec![None; POST_COUNT];
        for &[a, b, c] in &vertices[2..TRIANGLE_COUNT / 2] {
            let post = middle(a, b);
            match seen[bit(post)] {
                Some(at) => {
                    let split: &mut Split = &mut splits[at];
                    split.needs[1] = c;
                }
                None => {
                    seen[bit(post)] = Some(splits.len());
                    splits.push(Split { post, ends: [a, b], needs: [c, c] });
                }
            }
        }
        splits
    }
}

/// All posts but the corners, coarse to fine: each after all that it needs and the ends of its hypotenuse.
pub fn splits(diagonal: Diagonal) -> &'static [Split] {
    &diagonal.tables().splits
}

fn bit((column, row): Post) -> usize {
    usize::from(row) * (SIDE + 1) + usize::from(column)
}

/// A set of posts; the corners are always in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Active {
    words: [u64; POST_COUNT.div_ceil(64)],
}

impl Default for Active {
    fn default() -> Self {
        Self::corners()
    }
}

impl Active {
    /// The corners only: two triangles.
    pub fn corners() -> Self {
        let mut active = Self { words: [0; POST_COUNT.div_ceil(64)] };
        for corner in CORNERS {
            active.insert(corner);
        }
        active
    }

    /// All posts: 8,192 triangles.
    pub fn full() -> Self {
        let mut active = Self::corners();
        for split in splits(Diagonal::Rising) {
            active.insert(split.post);
        }
        active
    }

    /// The network that splits every flagged triangle (by heap number, [`TRIANGLE_COUNT`] flags; missing ones are
    /// false) and what that needs.
    pub fn from_split(diagonal: Diagonal, split: &[bool]) -> Self {
        let mut active = Self::corners();
        for triangle in Triangle::all().filter(|triangle| split.get(triangle.index()) == Some(&true)) {
            if let Some(post) = triangle.split_post(diagonal) {
                active.insert(post);
            }
        }
        active.close(diagonal);
        active
    }

    /// The coarsest network that holds this one's posts and none of whose triangles exceeds, the smallest excepted.
    pub fn refine(mut self, diagonal: Diagonal, exceeds: &dyn Fn(Triangle) -> bool) -> Self {
        self.close(diagonal);
        loop {
            let mut posts = Vec::new();
            self.visit(diagonal, &mut |triangle| {
                posts.extend(triangle.split_post(diagonal).filter(|_| exceeds(triangle)));
            });
            if posts.is_empty() {
                return self;
            }
            for post in posts {
                self.insert(post);
            }
            self.close(diagonal);
        }
    }

    /// False outside the page.
    pub fn contains(&self, post: Post) -> bool {
        post.0 <= LAST && post.1 <= LAST && self.words[bit(post) / 64] >> (bit(post) % 64) & 1 == 1
    }

    /// Posts outside the page are ignored.
    pub fn insert(&mut self, post: Post) {
        if post.0 <= LAST && post.1 <= LAST {
            self.words[bit(post) / 64] |= 1 << (bit(post) % 64);
        }
    }

    pub fn extend(&mut self, other: &Self) {
        for (word, more) in self.words.iter_mut().zip(other.words) {
            *word |= more;
        }
    }

    #[expect(clippy::len_without_is_empty, reason = "the corners are always in it")]
    pub fn len(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// By rows from the south, columns from the west.
    pub fn posts(&self) -> impl Iterator<Item = Post> {
        (0..=LAST).flat_map(|row| (0..=LAST).map(move |column| (column, row))).filter(|&post| self.contains(post))
    }

    /// Adds the posts that others need.
    pub fn close(&mut self, diagonal: Diagonal) {
        for split in splits(diagonal).iter().rev() {
            if self.contains(split.post) {
                self.insert(split.needs[0]);
                self.insert(split.needs[1]);
            }
        }
    }

    pub fn is_closed(&self, diagonal: Diagonal) -> bool {
        splits(diagonal)
            .iter()
            .all(|split| !self.contains(split.post) || split.needs.iter().all(|&need| self.contains(need)))
    }

    /// The network's triangles, counter-clockwise from above, in depth-first order. The set must be closed.
    pub fn triangles(&self, diagonal: Diagonal) -> Vec<[Post; 3]> {
        let mut triangles = Vec::new();
        self.visit(diagonal, &mut |triangle| triangles.push(triangle.vertices(diagonal)));
        triangles
    }

    /// The network's triangles by heap number, in depth-first order.
    pub fn visit(&self, diagonal: Diagonal, visit: &mut dyn FnMut(Triangle)) {
        let mut stack = vec![Triangle::ROOTS[1], Triangle::ROOTS[0]];
        while let Some(triangle) = stack.pop() {
            match triangle.children() {
                Some([first, second]) if triangle.split_post(diagonal).is_some_and(|post| self.contains(post)) => {
                    stack.extend([second, first]);
                }
                _ => visit(triangle),
            }
        }
    }

    /// The triangle that holds a point; column and row in 0 to 64.
    pub fn find_triangle(&self, diagonal: Diagonal, column: f64, row: f64) -> Triangle {
        Triangle::find(diagonal, column, row, |post| self.contains(post))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forest::{Quadrant, Zone};
    use proptest::prelude::*;
    use std::collections::HashMap;

    const BOTH: [Diagonal; 2] = [Diagonal::Rising, Diagonal::Falling];

    /// Twice the signed area.
    fn area2([a, b, c]: [Post; 3]) -> i32 {
        let p = [a, b, c].map(|(x, y)| (i32::from(x), i32::from(y)));
        (p[1].0 - p[0].0) * (p[2].1 - p[0].1) - (p[2].0 - p[0].0) * (p[1].1 - p[0].1)
    }

    #[test]
    fn the_full_network_has_all_smallest_triangles_and_every_post_one_split() {
        for diagonal in BOTH {
            let all = Active::full();
            assert_eq!((all.len(), splits(diagonal).len()), (4225, 4221));
            assert!(all.is_closed(diagonal));
            let triangles = all.triangles(diagonal);
            assert_eq!(triangles.len(), 8192);
            assert!(triangles.iter().all(|&t| area2(t) == 1));
            let mut known = Active::corners();
            for split in splits(diagonal) {
                assert!(split.ends.iter().chain(&split.needs).all(|&post| known.contains(post)));
                known.insert(split.post);
            }
        }
    }

    #[test]
    fn two_triangles_stand_over_the_corners() {
        assert_eq!(
            Active::corners().triangles(Diagonal::Falling),
            vec![[(0, 64), (64, 0), (64, 64)], [(64, 0), (0, 64), (0, 0)]]
        );
    }

    #[test]
    fn a_childs_bintree_is_a_part_of_its_parents() {
        let parent = Zone::all().nth(17).unwrap().root();
        for (quadrant, at) in Quadrant::ALL.into_iter().zip([(0, 0), (32, 0), (0, 32), (32, 32)]) {
            let diagonal = Diagonal::of(parent.child(quadrant).unwrap());
            // The child's roots are triangles of the parent, two splits down.
            for root in Triangle::ROOTS {
                let mut halved = root.vertices(diagonal).map(|(x, y)| (x / 2 + at.0, y / 2 + at.1));
                halved.sort_unstable();
                assert!(Triangle::all().filter(|t| t.depth() == 2).any(|t| {
                    let mut vertices = t.vertices(Diagonal::of(parent));
                    vertices.sort_unstable();
                    vertices == halved
                }));
            }
        }
    }

    #[test]
    fn refining_stops_where_nothing_exceeds() {
        let touches = |t: Triangle| t.vertices(Diagonal::Rising).contains(&(0, 0));
        let active = Active::corners().refine(Diagonal::Rising, &touches);
        assert!(active.is_closed(Diagonal::Rising));
        assert!(active.len() < 60, "{}", active.len());
        let at = active.find_triangle(Diagonal::Rising, 0.1, 0.2);
        assert_eq!(at.depth(), DEPTH);
    }

    fn any_active() -> impl Strategy<Value = (Diagonal, Active)> {
        (any::<bool>(), proptest::collection::vec((0..=LAST, 0..=LAST), 0..40)).prop_map(|(rising, posts)| {
            let diagonal = BOTH[usize::from(rising)];
            let mut active = Active::corners();
            posts.into_iter().for_each(|post| active.insert(post));
            active.close(diagonal);
            (diagonal, active)
        })
    }

    proptest! {
        #[test]
        fn a_closed_network_covers_the_square_once_without_t_junctions((diagonal, active) in any_active()) {
            prop_assert!(active.is_closed(diagonal));
            let triangles = active.triangles(diagonal);
            prop_assert_eq!(triangles.iter().map(|&t| area2(t)).sum::<i32>(), 2 * 64 * 64);
            prop_assert!(triangles.iter().all(|&t| area2(t) > 0));
            let mut edges = HashMap::new();
            for t in &triangles {
                for (from, to) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                    *edges.entry((from, to)).or_insert(0) += 1;
                }
            }
            for &(from, to) in edges.keys() {
                let border = (from.0 == to.0 && [0, LAST].contains(&from.0)) || (from.1 == to.1 && [0, LAST].contains(&from.1));
                prop_assert!(border || edges.contains_key(&(to, from)), "{from:?} {to:?}");
            }
            let mut used: Vec<Post> = triangles.concat();
            used.sort_by_key(|&(column, row)| (row, column));
            used.dedup();
            prop_assert_eq!(used, active.posts().collect::<Vec<_>>());
        }

        #[test]
        fn a_point_is_found_in_a_triangle_that_holds_it(
            (diagonal, active) in any_active(), u in 0.0..=64.0f64, v in 0.0..=64.0f64,
        ) {
            let found = active.find_triangle(diagonal, u, v);
            let p = found.vertices(diagonal).map(|(x, y)| (f64::from(x), f64::from(y)));
            for i in 0..3 {
                let (a, b) = (p[i], p[(i + 1) % 3]);
                prop_assert!((b.0 - a.0) * (v - a.1) - (b.1 - a.1) * (u - a.0) >= -1e-9);
            }
            prop_assert!(Triangle::lineage(diagonal, u, v).contains(&found));
            let mut listed = false;
            active.visit(diagonal, &mut |t| listed |= t == found);
            prop_assert!(listed);
        }
    }
}
