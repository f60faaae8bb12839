/* How the tests talk to a parser: a document comes in as its length (four octets, most significant first) and its
 * octets; the answer goes out the same way: strings that end with NUL, three for each thing read (KIND, PATH, VALUE).
 * KIND is E (an element with elements in it), V (one without: a value), A (an attribute of the last one) or
 * R (refused; VALUE says why, in the parser's words). A name or value in C never holds a NUL, so nothing is escaped.
 */
#ifndef DOCUMENT_STREAM_H
#define DOCUMENT_STREAM_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct octets {
    char *start;
    size_t length, room;
};

static void append(struct octets *to, const char *from, size_t length)
{
    if (to->room - to->length < length) {
        to->room = 2 * to->room + length + 4096;
        to->start = (char *)realloc(to->start, to->room);
        if (to->start == NULL)
            abort();
    }
    if (length > 0)
        memcpy(to->start + to->length, from, length);
    to->length += length;
}

static void append_string(struct octets *to, const char *text)
{
    append(to, text, strlen(text) + 1);
}

/* Reads a document and ends it with a NUL, which is not counted. Returns 0 at the end of the input. */
static int next_document(struct octets *document)
{
    unsigned char length[4];
    if (fread(length, 1, 4, stdin) != 4)
        return 0;
    size_t left = (size_t)length[0] << 24 | (size_t)length[1] << 16 | (size_t)length[2] << 8 | length[3];
    document->length = 0;
    char piece[4096];
    while (left > 0) {
        size_t wanted = left < sizeof piece ? left : sizeof piece;
        if (fread(piece, 1, wanted, stdin) != wanted)
            return 0;
        append(document, piece, wanted);
        left -= wanted;
    }
    append(document, "", 1);
    document->length--;
    return 1;
}

static void answer(FILE *to, const struct octets *reading)
{
    uint32_t n = (uint32_t)reading->length;
    unsigned char length[4] = {(unsigned char)(n >> 24), (unsigned char)(n >> 16), (unsigned char)(n >> 8),
                               (unsigned char)n};
    fwrite(length, 1, 4, to);
    fwrite(reading->start, 1, reading->length, to);
    fflush(to);
}

#endif
