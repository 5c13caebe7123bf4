/*
 * Chronotope: visual topological localisation that knows what each place looks like at a given time.
 *
 * Every function gives a status; what went wrong is said by chronotope_error_message() and its
 * sisters, for each thread by itself, until the next call of that thread fails. Handles are opaque:
 * made by a function that ends in _open, _new or _learn, given back to the _free of their kind, once.
 * A handle that is NULL is a status, never a crash; one that was freed or made up is undefined.
 * Times are microseconds since 1970-01-01T00:00:00Z. Names are UTF-8.
 *
 * Made by cbindgen from bindings/c/src; do not edit.
 */

#ifndef CHRONOTOPE_H
#define CHRONOTOPE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/**
 * A time that nobody knows: methods without rhythms need none.
 */
#define CHRONOTOPE_NO_TIME INT64_MIN

/**
 * How a call ended. Values never change their meaning; new ones may be added.
 */
typedef enum {
  /**
   * It did what it should.
   */
  CHRONOTOPE_STATUS_OK = 0,
  /**
   * A file or the disk.
   */
  CHRONOTOPE_STATUS_IO = 1,
  /**
   * A file that is not what it should be.
   */
  CHRONOTOPE_STATUS_FORMAT = 2,
  /**
   * A file that was changed or damaged.
   */
  CHRONOTOPE_STATUS_CHECKSUM = 3,
  /**
   * Settings that cannot be.
   */
  CHRONOTOPE_STATUS_CONFIG = 4,
  /**
   * An image of the wrong size, or fewer bytes than its size needs.
   */
  CHRONOTOPE_STATUS_SHAPE = 5,
  /**
   * A time that is missing or impossible.
   */
  CHRONOTOPE_STATUS_TIME = 6,
  /**
   * Something that is not there.
   */
  CHRONOTOPE_STATUS_NOT_FOUND = 7,
  /**
   * Something that is there already.
   */
  CHRONOTOPE_STATUS_ALREADY_EXISTS = 8,
  /**
   * Another process was faster; try again.
   */
  CHRONOTOPE_STATUS_CONFLICT = 9,
  /**
   * Stopped on request.
   */
  CHRONOTOPE_STATUS_INTERRUPTED = 10,
  /**
   * An argument that no caller may give: NULL, or an index beyond the end.
   */
  CHRONOTOPE_STATUS_ARGUMENT = 11,
  /**
   * A fault of this library: it was caught, and what it was working on should be freed.
   */
  CHRONOTOPE_STATUS_PANIC = 12,
  /**
   * Anything that this version has no word for.
   */
  CHRONOTOPE_STATUS_OTHER = 13,
} ChronotopeStatus;

/**
 * What to believe of an image.
 */
typedef enum {
  /**
   * No place fits well enough.
   */
  CHRONOTOPE_DECISION_UNKNOWN = 0,
  /**
   * The robot is at the place.
   */
  CHRONOTOPE_DECISION_AT = 1,
  /**
   * It is at the place or at one beside it.
   */
  CHRONOTOPE_DECISION_NEAR = 2,
  /**
   * It is in the map, but several places fit.
   */
  CHRONOTOPE_DECISION_AMBIGUOUS = 3,
} ChronotopeDecision;

/**
 * How the bytes of a pixel are meant.
 */
typedef enum {
  /**
   * One byte, the brightness.
   */
  CHRONOTOPE_PIXELS_GRAY8 = 0,
  /**
   * Blue, green, red: as OpenCV keeps them.
   */
  CHRONOTOPE_PIXELS_BGR8 = 1,
  /**
   * Red, green, blue.
   */
  CHRONOTOPE_PIXELS_RGB8 = 2,
} ChronotopePixels;

/**
 * A map that answers.
 */
typedef struct ChronotopeLocalizer ChronotopeLocalizer;

/**
 * A map as it was when it was opened.
 */
typedef struct ChronotopeMap ChronotopeMap;

/**
 * The loop of a robot: it localises image after image and, if wanted, learns from them.
 */
typedef struct ChronotopeRobot ChronotopeRobot;

/**
 * What one thread works in: memory, the features of its last image, and its last answer.
 */
typedef struct ChronotopeScratch ChronotopeScratch;

/**
 * One state over time: a door that is open or not.
 */
typedef struct ChronotopeSeries ChronotopeSeries;

/**
 * What was learnt of a series.
 */
typedef struct ChronotopeSeriesModel ChronotopeSeriesModel;

/**
 * An image that the caller owns. Grey pixels are read where they lie; colours are copied.
 */
typedef struct {
  /**
   * The first pixel of the first row.
   */
  const uint8_t *data;
  /**
   * Columns.
   */
  size_t width;
  /**
   * Rows.
   */
  size_t height;
  /**
   * Bytes from one row to the next; 0: without padding.
   */
  size_t stride;
  /**
   * What a `ChronotopePixels` says of the bytes.
   */
  uint32_t pixels;
} ChronotopeImage;

/**
 * Where an image was taken. `node` is the first place of the ranking, whatever was decided; its
 * name is `chronotope_..._place_name` of whatever answered.
 */
typedef struct {
  /**
   * What to believe.
   */
  ChronotopeDecision decision;
  /**
   * The first place; -1 in a map without places.
   */
  int64_t node;
  /**
   * The probability of being there.
   */
  double posterior;
  /**
   * The probability of being at no place of the map.
   */
  double off_map;
  /**
   * What it was ranked by.
   */
  double score;
  /**
   * How many places are ranked.
   */
  size_t num_ranked;
  /**
   * How many of them share the best score.
   */
  size_t num_tied;
  /**
   * Features of the image.
   */
  size_t num_features;
  /**
   * How many features of the first place were found in it.
   */
  uint32_t num_matches;
  /**
   * How many of those agree on a displacement.
   */
  uint32_t num_inliers;
  /**
   * That displacement: by how much the image is moved to the right and down, px.
   */
  double dx_px;
  /**
   * Down.
   */
  double dy_px;
} ChronotopeAnswer;

/**
 * One feature of an image.
 */
typedef struct {
  /**
   * The column of its middle, px.
   */
  float x;
  /**
   * The row of its middle, px.
   */
  float y;
  /**
   * How large it is, px.
   */
  float size;
  /**
   * How strong it is.
   */
  float response;
  /**
   * Its 256 bits, 64 at a time.
   */
  uint64_t descriptor[4];
} ChronotopeFeature;

/**
 * One place of a ranking.
 */
typedef struct {
  /**
   * The place.
   */
  uint32_t node;
  /**
   * Features of it that were found.
   */
  uint32_t num_matches;
  /**
   * How many of those agree on a displacement.
   */
  uint32_t num_inliers;
  /**
   * What it is ranked by.
   */
  double score;
  /**
   * The probability of being there.
   */
  double posterior;
} ChronotopeCandidate;

/**
 * What a robot does beside answering.
 */
typedef struct {
  /**
   * How often an answer may name a wrong place, from 0 to 1; negative: the default.
   */
  double risk;
  /**
   * Whether what was believed before moves along the map's edges and counts too.
   */
  bool tracks;
  /**
   * Whether located images are learnt, on a second thread, and committed to the map file.
   */
  bool learns;
} ChronotopeRobotConfig;

/**
 * What a robot has done so far.
 */
typedef struct {
  /**
   * Images that were answered.
   */
  size_t num_images;
  /**
   * Images that were located at a place.
   */
  size_t num_located;
  /**
   * Visits that were learnt.
   */
  size_t num_learnt;
  /**
   * Visits that were quarantined.
   */
  size_t num_quarantined;
  /**
   * Located images that could not be learnt, or found the learner busy.
   */
  size_t num_not_learnt;
} ChronotopeTotals;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Opens a map file for answers. `risk` is how often an answer may name a wrong place, from 0 to 1;
 * negative: the default. Any thread; takes as long as the map is large.
 *
 * # Safety
 *
 * `path` is a text that ends in a zero, and `out` can be written.
 */
ChronotopeStatus chronotope_localizer_open(const char *path,
                                           double risk,
                                           ChronotopeLocalizer **out);

/**
 * Frees it; NULL is nothing. Not while another thread uses it.
 *
 * # Safety
 *
 * `localizer` is NULL or comes from `chronotope_localizer_open` and was not freed.
 */
void chronotope_localizer_free(ChronotopeLocalizer *localizer);

/**
 * The name of a place, which lives as long as the localizer. Any number of threads at once.
 *
 * # Safety
 *
 * `localizer` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_localizer_place_name(const ChronotopeLocalizer *localizer,
                                                 size_t node,
                                                 const char **out);

/**
 * What one thread works in. Any number of threads at once; it may outlive the localizer, and be
 * used with another.
 *
 * # Safety
 *
 * `localizer` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_scratch_new(const ChronotopeLocalizer *localizer,
                                        ChronotopeScratch **out);

/**
 * Frees it; NULL is nothing. Not while another thread uses it.
 *
 * # Safety
 *
 * `scratch` is NULL or comes from `chronotope_scratch_new` and was not freed.
 */
void chronotope_scratch_free(ChronotopeScratch *scratch);

/**
 * Finds the features of an image, and keeps them in the scratch. Any number of threads at once,
 * each with its own scratch.
 *
 * # Safety
 *
 * The handles are NULL or were not freed, and no other thread uses the scratch meanwhile; the
 * image's bytes can be read as it says.
 */
ChronotopeStatus chronotope_extract(const ChronotopeLocalizer *localizer,
                                    ChronotopeScratch *scratch,
                                    const ChronotopeImage *image);

/**
 * Says where an image was taken: `chronotope_extract`, then `chronotope_localize_features`.
 *
 * `time_us` is when it was taken. An image of another size than the map's is a status of SHAPE. Any
 * number of threads at once, each with its own scratch.
 *
 * # Safety
 *
 * As for `chronotope_extract`; `out` can be written.
 */
ChronotopeStatus chronotope_localize(const ChronotopeLocalizer *localizer,
                                     ChronotopeScratch *scratch,
                                     const ChronotopeImage *image,
                                     int64_t time_us,
                                     ChronotopeAnswer *out);

/**
 * Says where the image was taken whose features are in the scratch. Any number of threads at once,
 * each with its own scratch.
 *
 * # Safety
 *
 * The handles are NULL or were not freed, and no other thread uses the scratch meanwhile; `out` can
 * be written.
 */
ChronotopeStatus chronotope_localize_features(const ChronotopeLocalizer *localizer,
                                              ChronotopeScratch *scratch,
                                              int64_t time_us,
                                              ChronotopeAnswer *out);

/**
 * How many features the last image had. One thread at a time for each scratch.
 *
 * # Safety
 *
 * `scratch` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_scratch_num_features(const ChronotopeScratch *scratch, size_t *out);

/**
 * One feature of the last image. One thread at a time for each scratch.
 *
 * # Safety
 *
 * `scratch` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_scratch_feature(const ChronotopeScratch *scratch,
                                            size_t index,
                                            ChronotopeFeature *out);

/**
 * One place of the last answer's ranking, the best at 0. One thread at a time for each scratch.
 *
 * # Safety
 *
 * `scratch` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_scratch_candidate(const ChronotopeScratch *scratch,
                                              size_t rank,
                                              ChronotopeCandidate *out);

/**
 * Opens a map file; it is only read. Any thread.
 *
 * # Safety
 *
 * `path` is a text that ends in a zero, and `out` can be written.
 */
ChronotopeStatus chronotope_map_open(const char *path, ChronotopeMap **out);

/**
 * Frees a map; NULL is nothing. Not while another thread uses it.
 *
 * # Safety
 *
 * `map` is NULL or comes from `chronotope_map_open` and was not freed.
 */
void chronotope_map_free(ChronotopeMap *map);

/**
 * How many places a map has. Any number of threads at once.
 *
 * # Safety
 *
 * `map` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_map_num_places(const ChronotopeMap *map, size_t *out);

/**
 * The name of a place, which lives as long as the map. Any number of threads at once.
 *
 * # Safety
 *
 * `map` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_map_place_name(const ChronotopeMap *map, size_t node, const char **out);

/**
 * Where a place is, in metres, and whether that is known. Any number of threads at once.
 *
 * # Safety
 *
 * `map` is NULL or was not freed; `xyz` has room for three numbers, and `is_known` can be written.
 */
ChronotopeStatus chronotope_map_place_pose(const ChronotopeMap *map,
                                           size_t node,
                                           double *xyz,
                                           bool *is_known);

/**
 * Columns and rows of the images that a map was learnt from; 0 and 0 of an empty map. Any number of
 * threads at once.
 *
 * # Safety
 *
 * `map` is NULL or was not freed; `width` and `height` can be written.
 */
ChronotopeStatus chronotope_map_image_size(const ChronotopeMap *map,
                                           uint32_t *width,
                                           uint32_t *height);

/**
 * The defaults: no tracking, no learning. Any thread.
 */
ChronotopeRobotConfig chronotope_robot_config_default(void);

/**
 * Opens a map file for a robot. Any thread.
 *
 * # Safety
 *
 * `path` is a text that ends in a zero, `cfg` is NULL (the defaults) or can be read, and `out` can
 * be written.
 */
ChronotopeStatus chronotope_robot_open(const char *path,
                                       const ChronotopeRobotConfig *cfg,
                                       ChronotopeRobot **out);

/**
 * Frees a robot; what it has learnt is committed, but nobody hears whether that worked:
 * `chronotope_robot_commit` says so. NULL is nothing. Not while another thread uses it.
 *
 * # Safety
 *
 * `robot` is NULL or comes from `chronotope_robot_open` and was not freed.
 */
void chronotope_robot_free(ChronotopeRobot *robot);

/**
 * Says where an image was taken at `time_us`, and learns it if that is wanted and it was located.
 * One thread at a time for each robot.
 *
 * # Safety
 *
 * `robot` is NULL or was not freed; the image's bytes can be read as it says, and `out` can be
 * written.
 */
ChronotopeStatus chronotope_robot_see(ChronotopeRobot *robot,
                                      const ChronotopeImage *image,
                                      int64_t time_us,
                                      ChronotopeAnswer *out);

/**
 * The name of a place, which lives until the next image is seen. One thread at a time for each
 * robot.
 *
 * # Safety
 *
 * `robot` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_robot_place_name(const ChronotopeRobot *robot,
                                             size_t node,
                                             const char **out);

/**
 * One place of the last answer's ranking, the best at 0. One thread at a time for each robot.
 *
 * # Safety
 *
 * `robot` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_robot_candidate(const ChronotopeRobot *robot,
                                            size_t rank,
                                            ChronotopeCandidate *out);

/**
 * Waits until everything that was located has been learnt and is in the map file; gives what was
 * done so far. One thread at a time for each robot.
 *
 * # Safety
 *
 * `robot` is NULL or was not freed; `totals` is NULL or can be written.
 */
ChronotopeStatus chronotope_robot_commit(ChronotopeRobot *robot, ChronotopeTotals *totals);

/**
 * An empty series. Any thread.
 *
 * # Safety
 *
 * `out` can be written.
 */
ChronotopeStatus chronotope_series_new(ChronotopeSeries **out);

/**
 * Frees it; NULL is nothing. Not while another thread uses it.
 *
 * # Safety
 *
 * `series` is NULL or comes from `chronotope_series_new` and was not freed.
 */
void chronotope_series_free(ChronotopeSeries *series);

/**
 * Adds what was seen at a time: 1 true, 0 false, -1 nobody could see. Times come in any order. One
 * thread at a time for each series.
 *
 * # Safety
 *
 * `series` is NULL or was not freed.
 */
ChronotopeStatus chronotope_series_add(ChronotopeSeries *series, int64_t time_us, int32_t state);

/**
 * Learns the rhythms of a series. One thread at a time for each series.
 *
 * # Safety
 *
 * `series` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_series_learn(const ChronotopeSeries *series,
                                         ChronotopeSeriesModel **out);

/**
 * Frees it; NULL is nothing. Not while another thread uses it.
 *
 * # Safety
 *
 * `model` is NULL or comes from `chronotope_series_learn` and was not freed.
 */
void chronotope_series_model_free(ChronotopeSeriesModel *model);

/**
 * The probability that the state is true at a time. Any number of threads at once.
 *
 * # Safety
 *
 * `model` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_series_model_p(const ChronotopeSeriesModel *model,
                                           int64_t time_us,
                                           double *out);

/**
 * How many rhythms were found. Any number of threads at once.
 *
 * # Safety
 *
 * `model` is NULL or was not freed, and `out` can be written.
 */
ChronotopeStatus chronotope_series_model_order(const ChronotopeSeriesModel *model, size_t *out);

/**
 * The number of the binary interface: a program that was compiled for another number must not go
 * on. Any thread.
 */
uint32_t chronotope_abi_version(void);

/**
 * The version of the library, as text. Any thread; never freed.
 */
const char *chronotope_version(void);

/**
 * The status of this thread's last call that failed; OK if none has.
 */
ChronotopeStatus chronotope_error_status(void);

/**
 * What went wrong in this thread's last call that failed; NULL if none has. Until the next one
 * fails.
 */
const char *chronotope_error_message(void);

/**
 * The file that was wrong, or NULL; as `chronotope_error_message`.
 */
const char *chronotope_error_path(void);

/**
 * The place in it, or NULL; as `chronotope_error_message`.
 */
const char *chronotope_error_place(void);

/**
 * What helps, or NULL; as `chronotope_error_message`.
 */
const char *chronotope_error_help(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* CHRONOTOPE_H */
