/*
 * Where was this image taken?
 *
 *     localize MAP SECONDS IMAGE.pgm
 *
 * prints the decision, the place and how sure that is. What goes wrong is said with what helps.
 */
#include <stdio.h>
#include <stdlib.h>

#include "chronotope.h"
#include "pgm.h"

static int failed(void)
{
    const char *path = chronotope_error_path();
    const char *help = chronotope_error_help();
    fprintf(stderr, "error %d: %s%s%s", (int)chronotope_error_status(), path ? path : "",
            path ? ": " : "", chronotope_error_message());
    fprintf(stderr, help ? " (help: %s)\n" : "\n", help);
    return 2;
}

int main(int argc, char **argv)
{
    static const char *const decisions[] = {"unknown", "at", "near", "ambiguous"};
    ChronotopeLocalizer *localizer = NULL;
    ChronotopeScratch *scratch = NULL;
    ChronotopeImage image = {NULL, 0, 0, 0, CHRONOTOPE_PIXELS_GRAY8};
    ChronotopeAnswer answer;
    uint8_t *pixels;
    int result = 2;

    if (argc != 4) {
        fprintf(stderr, "usage: %s MAP SECONDS IMAGE.pgm\n", argv[0]);
        return 2;
    }
    if (chronotope_abi_version() != 1) {
        fprintf(stderr, "this program was compiled for another libchronotope\n");
        return 2;
    }
    pixels = read_pgm(argv[3], &image.width, &image.height);
    if (pixels == NULL) {
        fprintf(stderr, "%s is no PGM file\n", argv[3]);
        return 2;
    }
    image.data = pixels;
    if (chronotope_localizer_open(argv[1], -1.0, &localizer) != CHRONOTOPE_STATUS_OK ||
        chronotope_scratch_new(localizer, &scratch) != CHRONOTOPE_STATUS_OK ||
        chronotope_localize(localizer, scratch, &image, (int64_t)atoll(argv[2]) * 1000000,
                            &answer) != CHRONOTOPE_STATUS_OK) {
        result = failed();
    } else {
        const char *name = "none";
        if (answer.node >= 0) {
            chronotope_localizer_place_name(localizer, (size_t)answer.node, &name);
        }
        printf("%s %s %.6f %lu features, %lu inliers\n", decisions[answer.decision], name,
               answer.posterior, (unsigned long)answer.num_features,
               (unsigned long)answer.num_inliers);
        result = answer.decision == CHRONOTOPE_DECISION_AT ? 0 : 1;
    }
    chronotope_scratch_free(scratch);
    chronotope_localizer_free(localizer);
    free(pixels);
    return result;
}
