//! Faces of a detail that meet in their picture.

use crate::content::Detail;

/// What some connected faces show of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Island {
    /// Which of the pictures given with the object.
    pub picture: u32,
    /// Left, upper, right and lower end, as parts of the picture's sides.
    pub ends: [f32; 4],
}

/// The islands of a detail, and to which each corner belongs.
pub fn islands(detail: &Detail) -> (Vec<Island>, Vec<Option<usize>>) {
    let mut of_corner = vec![None; detail.corners.len()];
    let mut islands: Vec<Island> = Vec::new();
    if detail.uvs.len() != detail.corners.len() {
        return (islands, of_corner);
    }
    let mut union = Union((0..detail.corners.len() as u32).collect());
    let textured = || {
        let groups = detail.groups.iter().filter_map(|group| Some((group.texture?, &group.triangles)));
        groups.flat_map(|(picture, triangles)| triangles.iter().map(move |triangle| (picture, triangle)))
    };
    for (_, &[a, b, c]) in textured() {
        union.join(a, b);
        union.join(a, c);
    }
    for (picture, triangle) in textured() {
        let first = union.find(triangle[0]) as usize;
        let at = *of_corner[first].get_or_insert_with(|| {
            islands
                .push(Island { picture, ends: [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY] });
            islands.len() - 1
        });
        for &corner in triangle {
            of_corner[corner as usize] = Some(at);
            let ([u, v], ends) = (detail.uvs[corner as usize], &mut islands[at].ends);
            *ends = [ends[0].min(u), ends[1].min(v), ends[2].max(u), ends[3].max(v)];
        }
    }
    (islands, of_corner)
}

/// Sets of corners; each corner points towards the first of its set.
struct Union(Vec<u32>);

impl Union {
    fn find(&mut self, mut at: u32) -> u32 {
        while self.0[at as usize] != at {
            let above = self.0[self.0[at as usize] as usize];
            self.0[at as usize] = above;
            at = above;
        }
        at
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
