//! Where do most of the particles believe to be?

use std::collections::HashMap;

use crate::localize::kld::KldBound;
use crate::pose::{Pose2, wrap};

/// Where the robot is, and how surely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The mean of the heaviest group of particles.
    pub pose: Pose2,
    /// Their standard deviation in x and y together.
    pub deviation_m: f64,
    /// Their standard deviation in heading.
    pub deviation_rad: f64,
    /// The share of all weight that they have: low where the robot may be in several places.
    pub share: f64,
    /// Number of particles, of all groups.
    pub num_particles: usize,
    /// How well the scan fits the map, by the particles' weight: the geometric mean of the
    /// likelihood of a beam.
    pub fit: f64,
}

/// The heaviest of the groups into which particles fall: bins that touch.
///
/// `weights` add up to 1; `poses` are as many and at least one.
pub(super) fn heaviest(poses: &[Pose2], weights: &[f64], bound: &KldBound) -> Estimate {
    let mut number_of: HashMap<[i64; 3], usize> = HashMap::new();
    let mut bins: Vec<[i64; 3]> = Vec::new();
    let mut bin_of = Vec::with_capacity(poses.len());
    for pose in poses {
        let bin = bound.bin(pose);
        let number = *number_of.entry(bin).or_insert_with(|| {
            bins.push(bin);
            bins.len() - 1
        });
        bin_of.push(number);
    }
    let groups = touching(&bins, &number_of, bound);
    let mut weight_of = vec![0.0; bins.len()];
    for (bin, weight) in bin_of.iter().zip(weights) {
        weight_of[groups[*bin]] += weight;
    }
    // Of equals, the one that came first.
    let mut best = 0;
    for (group, weight) in weight_of.iter().enumerate() {
        if *weight > weight_of[best] {
            best = group;
        }
    }
    let members = (0..poses.len()).filter(|&index| groups[bin_of[index]] == best);
    mean(members, poses, weights)
}

/// For each bin the smallest number of the bins that it is connected with.
fn touching(
    bins: &[[i64; 3]],
    number_of: &HashMap<[i64; 3], usize>,
    bound: &KldBound,
) -> Vec<usize> {
    let mut group = vec![usize::MAX; bins.len()];
    let mut open = Vec::new();
    for first in 0..bins.len() {
        if group[first] != usize::MAX {
            continue;
        }
        group[first] = first;
        open.push(first);
        while let Some(number) = open.pop() {
            let [x, y, heading] = bins[number];
            for step in 0..27_i64 {
                let turned = bound.heading(heading + step / 9 - 1);
                let near = [x + step % 3 - 1, y + step / 3 % 3 - 1, turned];
                if let Some(&other) = number_of.get(&near)
                    && group[other] == usize::MAX
                {
                    group[other] = first;
                    open.push(other);
                }
            }
        }
    }
    group
}

fn mean(
    members: impl Iterator<Item = usize> + Clone,
    poses: &[Pose2],
    weights: &[f64],
) -> Estimate {
    let (mut share, mut x, mut y, mut sin, mut cos) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for index in members.clone() {
        let (pose, weight) = (&poses[index], weights[index]);
        share += weight;
        x += weight * pose.x_m;
        y += weight * pose.y_m;
        sin += weight * pose.heading_rad.sin();
        cos += weight * pose.heading_rad.cos();
    }
    let scale = if share > 0.0 { 1.0 / share } else { 0.0 };
    let pose = Pose2::new(x * scale, y * scale, sin.atan2(cos));
    let (mut position, mut heading) = (0.0, 0.0);
    for index in members {
        let weight = weights[index] * scale;
        position += weight * poses[index].distance_m(&pose).powi(2);
        heading += weight * wrap(poses[index].heading_rad - pose.heading_rad).powi(2);
    }
    Estimate {
        pose,
        deviation_m: position.sqrt(),
        deviation_rad: heading.sqrt(),
        share,
        num_particles: poses.len(),
        fit: 0.0,
    }
}
