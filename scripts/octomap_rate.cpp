// How many voxels a second does OctoMap take in? The frames of `chronotope-eval speed`, section Grids:
// 213,000 voxels, of which 213 change from frame to frame; OctoMap is told of each voxel of each frame.
// Built and run by scripts/speed.sh where liboctomap is installed.
#include <octomap/octomap.h>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <random>
#include <vector>

static double seconds() {
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

int main() {
    const int width = 71, height = 60, depth = 50, frames = 20, changes = 213;
    const octomap::key_type center = 32768;
    std::vector<bool> occupied(size_t(width) * height * depth, false);
    std::mt19937 random(7);
    octomap::OcTree tree(0.1);
    double best = 1e9;
    for (int frame = 0; frame < frames; ++frame) {
        for (int change = 0; change < changes; ++change) {
            const size_t cell = random() % occupied.size();
            occupied[cell] = !occupied[cell];
        }
        const double start = seconds();
        size_t index = 0;
        for (int z = 0; z < depth; ++z)
            for (int y = 0; y < height; ++y)
                for (int x = 0; x < width; ++x)
                    tree.updateNode(octomap::OcTreeKey(center + x, center + y, center + z),
                                    occupied[index++], true);
        tree.updateInnerOccupancy();
        best = std::min(best, seconds() - start);
    }
    std::printf("OctoMap, updateNode and updateInnerOccupancy: %.1e cell observations/s "
                "(processor time, the fastest of %d frames of %zu voxels)\n",
                double(occupied.size()) / best, frames, occupied.size());
    return 0;
}
