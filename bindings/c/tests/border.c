/*
 * What does the border do with what no caller may give it? Run under ASan and valgrind.
 *
 *     border MAP
 */
#include <stdio.h>
#include <string.h>

#include "chronotope.h"

static int num_failed = 0;

static void expect(int holds, const char *what)
{
    if (!holds) {
        const char *message = chronotope_error_message();
        fprintf(stderr, "failed: %s (%s)\n", what, message ? message : "no message");
        ++num_failed;
    }
}

#define EXPECT_STATUS(call, wanted) expect((call) == (wanted), #call)

int main(int argc, char **argv)
{
    ChronotopeMap *map = NULL;
    ChronotopeLocalizer *localizer = NULL;
    ChronotopeScratch *scratch = NULL;
    ChronotopeRobot *robot = NULL;
    ChronotopeSeries *series = NULL;
    ChronotopeSeriesModel *model = NULL;
    ChronotopeAnswer answer;
    ChronotopeCandidate candidate;
    ChronotopeFeature feature;
    ChronotopeImage image = {NULL, 4, 4, 0, CHRONOTOPE_PIXELS_GRAY8};
    uint8_t small[16] = {0};
    uint32_t width = 0, height = 0;
    const char *name = NULL;
    size_t num = 0;
    double p = 0.0, pose[3];
    bool is_known = false;

    if (argc != 2) {
        fprintf(stderr, "usage: %s MAP\n", argv[0]);
        return 2;
    }
    expect(chronotope_error_status() == CHRONOTOPE_STATUS_OK, "no error at first");
    expect(chronotope_error_message() == NULL, "no message at first");
    EXPECT_STATUS(chronotope_map_open(NULL, &map), CHRONOTOPE_STATUS_ARGUMENT);
    EXPECT_STATUS(chronotope_map_open("\xff", &map), CHRONOTOPE_STATUS_ARGUMENT);
    EXPECT_STATUS(chronotope_map_open("/nowhere/none.map", &map), CHRONOTOPE_STATUS_NOT_FOUND);
    expect(strstr(chronotope_error_path(), "none.map") != NULL, "the error names the file");
    EXPECT_STATUS(chronotope_map_open("/", &map), CHRONOTOPE_STATUS_FORMAT);
    EXPECT_STATUS(chronotope_map_open(argv[1], NULL), CHRONOTOPE_STATUS_ARGUMENT);
    EXPECT_STATUS(chronotope_map_open(argv[1], &map), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_map_num_places(map, &num), CHRONOTOPE_STATUS_OK);
    expect(num == 4, "the street has four places");
    EXPECT_STATUS(chronotope_map_place_name(map, num, &name), CHRONOTOPE_STATUS_ARGUMENT);
    EXPECT_STATUS(chronotope_map_place_name(map, 0, &name), CHRONOTOPE_STATUS_OK);
    expect(name != NULL && strncmp(name, "place-", 6) == 0, "places have names");
    EXPECT_STATUS(chronotope_map_place_pose(map, 0, pose, &is_known), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_map_image_size(map, &width, &height), CHRONOTOPE_STATUS_OK);
    expect(width > 0 && height > 0, "images have a size");
    EXPECT_STATUS(chronotope_map_num_places(NULL, &num), CHRONOTOPE_STATUS_ARGUMENT);

    EXPECT_STATUS(chronotope_localizer_open(argv[1], 7.0, &localizer), CHRONOTOPE_STATUS_CONFIG);
    EXPECT_STATUS(chronotope_localizer_open(argv[1], 0.05, &localizer), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_scratch_new(localizer, &scratch), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_localize(localizer, scratch, NULL, 0, &answer),
                  CHRONOTOPE_STATUS_ARGUMENT);
    EXPECT_STATUS(chronotope_localize(localizer, scratch, &image, 0, &answer),
                  CHRONOTOPE_STATUS_ARGUMENT);
    image.data = small;
    EXPECT_STATUS(chronotope_localize(localizer, scratch, &image, 0, &answer),
                  CHRONOTOPE_STATUS_SHAPE);
    image.stride = 3;
    EXPECT_STATUS(chronotope_localize(localizer, scratch, &image, 0, &answer),
                  CHRONOTOPE_STATUS_SHAPE);
    image.stride = 0;
    image.pixels = 99;
    EXPECT_STATUS(chronotope_extract(localizer, scratch, &image), CHRONOTOPE_STATUS_ARGUMENT);
    image.pixels = CHRONOTOPE_PIXELS_GRAY8;
    EXPECT_STATUS(chronotope_extract(localizer, scratch, &image), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_scratch_num_features(scratch, &num), CHRONOTOPE_STATUS_OK);
    expect(num == 0, "sixteen black pixels have no features");
    EXPECT_STATUS(chronotope_scratch_feature(scratch, 0, &feature), CHRONOTOPE_STATUS_ARGUMENT);
    EXPECT_STATUS(chronotope_scratch_candidate(scratch, 0, &candidate), CHRONOTOPE_STATUS_ARGUMENT);

    EXPECT_STATUS(chronotope_robot_open(argv[1], NULL, &robot), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_robot_see(robot, &image, 0, &answer), CHRONOTOPE_STATUS_SHAPE);
    EXPECT_STATUS(chronotope_robot_commit(robot, NULL), CHRONOTOPE_STATUS_OK);

    EXPECT_STATUS(chronotope_series_new(&series), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_series_add(series, 0, 2), CHRONOTOPE_STATUS_ARGUMENT);
    EXPECT_STATUS(chronotope_series_add(series, 0, 1), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_series_add(series, 1000000, -1), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_series_learn(series, &model), CHRONOTOPE_STATUS_OK);
    EXPECT_STATUS(chronotope_series_model_p(model, 5, &p), CHRONOTOPE_STATUS_OK);
    expect(p >= 0.0 && p <= 1.0, "p is a probability");
    EXPECT_STATUS(chronotope_series_model_p(NULL, 5, &p), CHRONOTOPE_STATUS_ARGUMENT);

    chronotope_series_model_free(model);
    chronotope_series_free(series);
    chronotope_robot_free(robot);
    chronotope_scratch_free(scratch);
    chronotope_localizer_free(localizer);
    chronotope_map_free(map);
    chronotope_map_free(NULL);
    printf("%s\n", num_failed == 0 ? "the border holds" : "the border does not hold");
    return num_failed == 0 ? 0 : 1;
}
