/*
 * A robot walks along a street, and asks when a door will be open.
 *
 *     robot MAP SECONDS IMAGE.pgm [SECONDS IMAGE.pgm ...]
 */
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <memory>

#include "chronotope.hpp"
#include "pgm.h"

namespace {

void ask_for_a_door() {
    chronotope::Series door;
    constexpr std::int64_t hour_us = 3600LL * 1000000;
    for (std::int64_t hour = 0; hour < 24 * 21; ++hour) {
        door.add(hour * hour_us, hour % 24 >= 8 && hour % 24 < 18);
    }
    const chronotope::SeriesModel model = door.learn();
    std::cout << "the door is open at noon with " << model.p((24 * 30 + 12) * hour_us)
              << ", at midnight with " << model.p(24 * 30 * hour_us) << "\n";
}

} // namespace

int main(int argc, char** argv) {
    if (argc < 4 || argc % 2 != 0) {
        std::cerr << "usage: " << argv[0] << " MAP SECONDS IMAGE.pgm [SECONDS IMAGE.pgm ...]\n";
        return 2;
    }
    try {
        chronotope::check_abi();
        chronotope::Robot robot(argv[1]);
        int num_located = 0;
        for (int i = 2; i + 1 < argc; i += 2) {
            std::size_t width = 0, height = 0;
            const std::unique_ptr<std::uint8_t, decltype(&std::free)> pixels(
                read_pgm(argv[i + 1], &width, &height), &std::free);
            if (!pixels) {
                std::cerr << argv[i + 1] << " is no PGM file\n";
                return 2;
            }
            const std::int64_t time_us = std::atoll(argv[i]) * 1000000LL;
            const ChronotopeAnswer answer =
                robot.see(chronotope::gray(pixels.get(), width, height), time_us);
            const bool is_located = answer.decision == CHRONOTOPE_DECISION_AT;
            num_located += is_located ? 1 : 0;
            std::cout << (is_located ? robot.place_name(static_cast<std::size_t>(answer.node))
                                     : "unknown")
                      << " " << answer.posterior << "\n";
        }
        const ChronotopeTotals totals = robot.commit();
        std::cout << num_located << " of " << totals.num_images << " located\n";
        ask_for_a_door();
        return static_cast<std::size_t>(num_located) == totals.num_located ? 0 : 1;
    } catch (const std::exception& error) {
        std::cerr << "error: " << error.what() << "\n";
        return 2;
    }
}
