/* Cyclone DDS itself, asked through its public API: does an enclave's participant start in a domain, and which
 * endpoints may it create? The properties are those that rmw_cyclonedds_cpp sets. No packet leaves the machine, and
 * none is sent to another participant: the only peer is the discard port of the loopback interface.
 *
 * In, each as a document of document_stream.h: the enclave's directory, domain (digits), endpoints: for each, strings
 * that end with NUL: P (publish) or S (subscribe), topic, how many partitions (digits), the partitions. Out, strings
 * that end with NUL: A (created) or R (refused), a message; then for each endpoint where it failed (or A: allowed),
 * and a message. Where: topic, group (publisher, subscriber), endpoint.
 */
#include <dds/dds.h>
#include <dds/ddsrt/log.h>
#include <unistd.h>

#include "cyclonedds_secure.h"
#include "document_stream.h"

struct text {
    char *value;
};
static const uint32_t text_operations[] = {DDS_OP_ADR | DDS_OP_TYPE_STR, offsetof(struct text, value), DDS_OP_RTS};
static const dds_topic_descriptor_t text_type = {
    .m_size = sizeof(struct text),
    .m_align = sizeof(char *),
    .m_typename = "Text",
    .m_nops = 2,
    .m_ops = text_operations,
    .m_meta = "",
};

/* The first complaint since the last answer: later ones only say what follows from it. */
static char complaint[512];

static void take_complaint(void *argument, const dds_log_data_t *data)
{
    (void)argument;
    if (complaint[0] == '\0' && (data->priority & (DDS_LC_FATAL | DDS_LC_ERROR | DDS_LC_WARNING)))
        snprintf(complaint, sizeof complaint, "%.*s", (int)data->size, data->message);
    complaint[strcspn(complaint, "\n")] = '\0';
}

static void say(struct octets *reading, const char *what, dds_return_t code)
{
    append_string(reading, what);
    if (complaint[0] == '\0' && code < 0)
        snprintf(complaint, sizeof complaint, "%s", dds_strretcode(code));
    append_string(reading, complaint);
    complaint[0] = '\0';
}

static dds_entity_t create_participant(int domain, const char *directory)
{
    dds_qos_t *qos = dds_create_qos();
    secure(qos, directory, "");
    dds_entity_t participant = dds_create_participant((dds_domainid_t)domain, qos, NULL);
    dds_delete_qos(qos);
    return participant;
}

static void try_endpoint(dds_entity_t participant, struct octets *reading, int publishes, const char *topic_name,
                         uint32_t partitions, const char **names)
{
    dds_entity_t topic = dds_create_topic(participant, &text_type, topic_name, NULL, NULL);
    if (topic < 0) {
        say(reading, "topic", topic);
        return;
    }
    dds_qos_t *qos = dds_create_qos();
    if (partitions > 0)
        dds_qset_partition(qos, partitions, names);
    dds_entity_t group =
        publishes ? dds_create_publisher(participant, qos, NULL) : dds_create_subscriber(participant, qos, NULL);
    dds_delete_qos(qos);
    dds_entity_t endpoint = group;
    if (group >= 0)
        endpoint = publishes ? dds_create_writer(group, topic, NULL, NULL) : dds_create_reader(group, topic, NULL, NULL);
    say(reading, group < 0 ? "group" : endpoint < 0 ? "endpoint" : "A", endpoint);
    if (group >= 0)
        dds_delete(group); /* and the endpoint in it */
    dds_delete(topic);
}

static void try_endpoints(dds_entity_t participant, struct octets *reading, const struct octets *endpoints)
{
    enum { MOST = 64 };
    const char *partitions[MOST];
    for (const char *at = endpoints->start, *end = at + endpoints->length; at < end;) {
        int publishes = *at == 'P';
        const char *topic = at + 2;
        at = topic + strlen(topic) + 1;
        uint32_t count = (uint32_t)atoi(at);
        at += strlen(at) + 1;
        if (count > MOST)
            abort();
        for (uint32_t i = 0; i < count; i++, at += strlen(at) + 1)
            partitions[i] = at;
        try_endpoint(participant, reading, publishes, topic, count, partitions);
    }
}

int main(void)
{
    enum { SECONDS = 20 };
    FILE *answers = fdopen(dup(STDOUT_FILENO), "w");
    if (answers == NULL || dup2(STDERR_FILENO, STDOUT_FILENO) < 0)
        return 1;
    setenv("CYCLONEDDS_URI",
           "<General><Interfaces><NetworkInterface address=\"127.0.0.1\" multicast=\"false\"/></Interfaces>"
           "<AllowMulticast>false</AllowMulticast></General>"
           "<Discovery><ParticipantIndex>none</ParticipantIndex><Peers><Peer address=\"127.0.0.1:9\"/></Peers>"
           "</Discovery>",
           1);
    dds_set_log_sink(take_complaint, NULL);
    dds_set_trace_sink(take_complaint, NULL);
    struct octets directory = {NULL, 0, 0}, domain = {NULL, 0, 0}, endpoints = {NULL, 0, 0}, reading = {NULL, 0, 0};
    while (next_document(&directory) && next_document(&domain) && next_document(&endpoints)) {
        alarm(SECONDS); /* a keystore on which it hangs ends the process, as one that crashes it does */
        reading.length = 0;
        complaint[0] = '\0';
        dds_entity_t participant = create_participant(atoi(domain.start), directory.start);
        say(&reading, participant < 0 ? "R" : "A", participant);
        if (participant >= 0) {
            try_endpoints(participant, &reading, &endpoints);
            dds_delete(participant);
        }
        alarm(0);
        answer(answers, &reading);
    }
    return 0;
}
