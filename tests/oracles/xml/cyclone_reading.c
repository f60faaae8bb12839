/* What the parser of Cyclone DDS reads in a document: its access control plugin is made of such callbacks, and a data
 * callback hands over the text of an element. <dds/ddsrt/xmlparser.h> declares the parser.
 */
#include <dds/ddsrt/xmlparser.h>

#include "document_stream.h"

struct element {
    struct element *parent;
    size_t path_length, attributes_start;
    int has_elements, times_data;
    struct octets value;
    size_t place; /* where the answer says V, which becomes E when an element turns up inside */
};

struct state {
    struct octets reading, path;
    struct element *current;
    char why[200];
};

static void pop(struct state *s)
{
    struct element *e = s->current;
    s->current = e->parent;
    s->path.length = e->parent == NULL ? 0 : e->parent->path_length;
    free(e->value.start);
    free(e);
}

/* The text of an element comes after its attributes; the answer has it before them. */
static void settle(struct state *s, struct element *e)
{
    struct octets tail = {NULL, 0, 0};
    append(&tail, s->reading.start + e->attributes_start, s->reading.length - e->attributes_start);
    s->reading.length = e->attributes_start;
    append(&s->reading, e->value.start, e->value.length);
    append(&s->reading, "", 1);
    append(&s->reading, tail.start, tail.length);
    free(tail.start);
}

static void add_path(struct state *s, const char *attribute)
{
    append(&s->reading, s->path.start, s->path.length);
    if (attribute != NULL) {
        append(&s->reading, "@", 1);
        append(&s->reading, attribute, strlen(attribute));
    }
    append(&s->reading, "", 1);
}

static int open_element(void *varg, uintptr_t parentinfo, uintptr_t *eleminfo, const char *name, int line)
{
    struct state *s = varg;
    struct element *e = calloc(1, sizeof *e);
    (void)parentinfo, (void)line;
    if (e == NULL)
        abort();
    if (s->current != NULL) {
        if (!s->current->has_elements) {
            s->current->has_elements = 1;
            s->reading.start[s->current->place] = 'E';
            s->current->value.length = 0;
            settle(s, s->current);
        }
        append(&s->path, "/", 1);
    }
    append(&s->path, name, strlen(name));
    e->parent = s->current;
    e->path_length = s->path.length;
    e->place = s->reading.length;
    s->current = e;
    append_string(&s->reading, "V");
    add_path(s, NULL);
    e->attributes_start = s->reading.length;
    *eleminfo = (uintptr_t)e;
    return 1;
}

static int attribute(void *varg, uintptr_t eleminfo, const char *name, const char *value, int line)
{
    struct state *s = varg;
    (void)eleminfo, (void)line;
    append_string(&s->reading, "A");
    add_path(s, name);
    append_string(&s->reading, value);
    return 1;
}

static int data(void *varg, uintptr_t eleminfo, const char *text, int line)
{
    struct state *s = varg;
    (void)eleminfo, (void)line;
    if (s->current->times_data++ > 0)
        append(&s->current->value, "|DATA|", 6); /* the plugin would take one of them: no reading of ours has that */
    append(&s->current->value, text, strlen(text));
    return 1;
}

static int close_element(void *varg, uintptr_t eleminfo, int line)
{
    struct state *s = varg;
    (void)eleminfo, (void)line;
    if (!s->current->has_elements)
        settle(s, s->current);
    pop(s);
    return 1;
}

static void error(void *varg, const char *message, int line)
{
    struct state *s = varg;
    snprintf(s->why, sizeof s->why, "line %d: %s", line, message);
}

int main(void)
{
    static const struct ddsrt_xmlp_callbacks callbacks = {open_element, attribute, data, close_element, error};
    struct octets document = {NULL, 0, 0};
    struct state s;
    memset(&s, 0, sizeof s);
    while (next_document(&document)) {
        s.reading.length = 0;
        s.why[0] = 0;
        struct ddsrt_xmlp_state *parser = ddsrt_xmlp_new_string(document.start, &s, &callbacks);
        int refused = ddsrt_xmlp_parse(parser) < 0;
        if (!refused && s.reading.length == 0) /* a text without a tag passes; the plugin then has no document */
            refused = snprintf(s.why, sizeof s.why, "no element") > 0;
        if (refused) {
            s.reading.length = 0;
            append_string(&s.reading, "R");
            append_string(&s.reading, "");
            append_string(&s.reading, s.why);
        }
        ddsrt_xmlp_free(parser);
        while (s.current != NULL)
            pop(&s);
        s.path.length = 0;
        answer(stdout, &s.reading);
    }
    return 0;
}
