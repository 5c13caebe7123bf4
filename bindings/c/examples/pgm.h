/* Reads a binary PGM file: what the examples have for a camera. */
#ifndef PGM_H
#define PGM_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/* The pixels, to be freed; NULL if it is no such file. */
static uint8_t *read_pgm(const char *path, size_t *width, size_t *height)
{
    FILE *file = fopen(path, "rb");
    unsigned long columns = 0, rows = 0, most = 0;
    uint8_t *pixels = NULL;
    if (file == NULL) {
        return NULL;
    }
    if (fscanf(file, "P5 %lu %lu %lu", &columns, &rows, &most) == 3 && most == 255 &&
        columns > 0 && rows > 0 && columns < 65536 && rows < 65536 && fgetc(file) == '\n') {
        pixels = (uint8_t *)malloc(columns * rows);
        if (pixels != NULL && fread(pixels, 1, columns * rows, file) != columns * rows) {
            free(pixels);
            pixels = NULL;
        }
    }
    fclose(file);
    *width = columns;
    *height = rows;
    return pixels;
}

#endif
