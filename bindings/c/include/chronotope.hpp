/*
 * Chronotope for C++17: chronotope.h with owners, exceptions and views.
 *
 * A status that is not OK is thrown as chronotope::Error, which copies what the library says of it.
 * Handles are moved, not copied. Which threads may use what stands at each function of chronotope.h.
 */
#ifndef CHRONOTOPE_HPP
#define CHRONOTOPE_HPP

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>

#include "chronotope.h"

namespace chronotope {

/* The number of the interface that this header is of. */
constexpr std::uint32_t abi_version = 1;

/* What a call failed with. */
class Error : public std::runtime_error {
public:
    Error(ChronotopeStatus status, std::string message, std::string path, std::string place,
          std::string help)
        : std::runtime_error(whole(message, path, place, help)), status_(status),
          message_(std::move(message)), path_(std::move(path)), place_(std::move(place)),
          help_(std::move(help)) {}

    ChronotopeStatus status() const noexcept { return status_; }
    const std::string& message() const noexcept { return message_; }
    const std::string& path() const noexcept { return path_; }
    const std::string& place() const noexcept { return place_; }
    const std::string& help() const noexcept { return help_; }

private:
    static std::string whole(const std::string& message, const std::string& path,
                             const std::string& place, const std::string& help) {
        std::string text = path;
        for (const std::string* part : {&place, &message}) {
            if (!part->empty()) {
                text += (text.empty() ? "" : ": ") + *part;
            }
        }
        return help.empty() ? text : text + " (help: " + help + ")";
    }

    ChronotopeStatus status_;
    std::string message_;
    std::string path_;
    std::string place_;
    std::string help_;
};

/* Throws what a status says, unless it is OK. */
inline void check(ChronotopeStatus status) {
    if (status == CHRONOTOPE_STATUS_OK) {
        return;
    }
    const auto text = [](const char* found) { return std::string(found != nullptr ? found : ""); };
    throw Error(status, text(chronotope_error_message()), text(chronotope_error_path()),
                text(chronotope_error_place()), text(chronotope_error_help()));
}

/* Throws if the library is of another interface than this header. */
inline void check_abi() {
    if (chronotope_abi_version() != abi_version) {
        throw std::runtime_error("libchronotope has another binary interface than chronotope.hpp");
    }
}

namespace detail {

template <typename Handle, void (*Free)(Handle*)>
struct Freer {
    void operator()(Handle* handle) const noexcept { Free(handle); }
};

template <typename Handle, void (*Free)(Handle*)>
using Owner = std::unique_ptr<Handle, Freer<Handle, Free>>;

} // namespace detail

/* A grey image; `stride` 0: rows without padding. */
inline ChronotopeImage gray(const std::uint8_t* data, std::size_t width, std::size_t height,
                            std::size_t stride = 0) {
    return {data, width, height, stride, CHRONOTOPE_PIXELS_GRAY8};
}

/* An image of OpenCV: cv::Mat of type CV_8UC3 gives data, cols, rows and step. */
inline ChronotopeImage bgr(const std::uint8_t* data, std::size_t width, std::size_t height,
                           std::size_t stride = 0) {
    return {data, width, height, stride, CHRONOTOPE_PIXELS_BGR8};
}

class Map {
public:
    explicit Map(const std::string& path) {
        ChronotopeMap* map = nullptr;
        check(chronotope_map_open(path.c_str(), &map));
        map_.reset(map);
    }

    std::size_t num_places() const {
        std::size_t num = 0;
        check(chronotope_map_num_places(map_.get(), &num));
        return num;
    }

    /* Lives as long as the map. */
    std::string_view place_name(std::size_t node) const {
        const char* name = nullptr;
        check(chronotope_map_place_name(map_.get(), node, &name));
        return name;
    }

private:
    detail::Owner<ChronotopeMap, chronotope_map_free> map_;
};

class Localizer;

/* What one thread works in. */
class Scratch {
public:
    explicit Scratch(const Localizer& localizer);

    ChronotopeScratch* get() noexcept { return scratch_.get(); }

    ChronotopeCandidate candidate(std::size_t rank) const {
        ChronotopeCandidate candidate{};
        check(chronotope_scratch_candidate(scratch_.get(), rank, &candidate));
        return candidate;
    }

    std::size_t num_features() const {
        std::size_t num = 0;
        check(chronotope_scratch_num_features(scratch_.get(), &num));
        return num;
    }

    ChronotopeFeature feature(std::size_t index) const {
        ChronotopeFeature feature{};
        check(chronotope_scratch_feature(scratch_.get(), index, &feature));
        return feature;
    }

private:
    detail::Owner<ChronotopeScratch, chronotope_scratch_free> scratch_;
};

/* A map that answers; shared by threads, each with its own scratch. */
class Localizer {
public:
    /* A negative risk is the default. */
    explicit Localizer(const std::string& path, double risk = -1.0) {
        ChronotopeLocalizer* localizer = nullptr;
        check(chronotope_localizer_open(path.c_str(), risk, &localizer));
        localizer_.reset(localizer);
    }

    const ChronotopeLocalizer* get() const noexcept { return localizer_.get(); }

    ChronotopeAnswer localize(Scratch& scratch, const ChronotopeImage& image,
                              std::int64_t time_us = CHRONOTOPE_NO_TIME) const {
        ChronotopeAnswer answer{};
        check(chronotope_localize(localizer_.get(), scratch.get(), &image, time_us, &answer));
        return answer;
    }

    /* Lives as long as the localizer. */
    std::string_view place_name(std::size_t node) const {
        const char* name = nullptr;
        check(chronotope_localizer_place_name(localizer_.get(), node, &name));
        return name;
    }

private:
    detail::Owner<ChronotopeLocalizer, chronotope_localizer_free> localizer_;
};

inline Scratch::Scratch(const Localizer& localizer) {
    ChronotopeScratch* scratch = nullptr;
    check(chronotope_scratch_new(localizer.get(), &scratch));
    scratch_.reset(scratch);
}

/* The loop of a robot; of one thread. */
class Robot {
public:
    explicit Robot(const std::string& path,
                   const ChronotopeRobotConfig& cfg = chronotope_robot_config_default()) {
        ChronotopeRobot* robot = nullptr;
        check(chronotope_robot_open(path.c_str(), &cfg, &robot));
        robot_.reset(robot);
    }

    ChronotopeAnswer see(const ChronotopeImage& image, std::int64_t time_us) {
        ChronotopeAnswer answer{};
        check(chronotope_robot_see(robot_.get(), &image, time_us, &answer));
        return answer;
    }

    /* Lives until the next image is seen. */
    std::string_view place_name(std::size_t node) const {
        const char* name = nullptr;
        check(chronotope_robot_place_name(robot_.get(), node, &name));
        return name;
    }

    /* Everything that was learnt is in the map file once this returns. */
    ChronotopeTotals commit() {
        ChronotopeTotals totals{};
        check(chronotope_robot_commit(robot_.get(), &totals));
        return totals;
    }

private:
    detail::Owner<ChronotopeRobot, chronotope_robot_free> robot_;
};

/* What was learnt of a state over time. */
class SeriesModel {
public:
    explicit SeriesModel(ChronotopeSeriesModel* model) : model_(model) {}

    double p(std::int64_t time_us) const {
        double p = 0.0;
        check(chronotope_series_model_p(model_.get(), time_us, &p));
        return p;
    }

private:
    detail::Owner<ChronotopeSeriesModel, chronotope_series_model_free> model_;
};

/* One state over time. */
class Series {
public:
    Series() {
        ChronotopeSeries* series = nullptr;
        check(chronotope_series_new(&series));
        series_.reset(series);
    }

    void add(std::int64_t time_us, bool state) {
        check(chronotope_series_add(series_.get(), time_us, state ? 1 : 0));
    }

    SeriesModel learn() const {
        ChronotopeSeriesModel* model = nullptr;
        check(chronotope_series_learn(series_.get(), &model));
        return SeriesModel(model);
    }

private:
    detail::Owner<ChronotopeSeries, chronotope_series_free> series_;
};

} // namespace chronotope

#endif
