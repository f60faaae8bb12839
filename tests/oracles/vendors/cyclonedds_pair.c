/* One of two processes of Cyclone DDS that meet on the loopback interface, over its public API: a participant in an
 * enclave, or a plain one, with writers and readers. Each writer writes its number again and again; each reader
 * remembers whose it got.
 *
 * Arguments: own number (0 or 1), first port of the pair, domain, the enclave's directory ("" for none), the library
 * to take instead of the access control plugin ("" for the real one: see cyclonedds_compromised.c), then for each
 * endpoint: P (publish) or S (subscribe), topic, how many partitions, the partitions.
 *
 * Out, a line each: "A" or "R" (participant created or refused), then the same for each endpoint. From then on, for
 * each line of the input: a line for each endpoint (how many endpoints it matched with, then the senders that it heard,
 * each 1000 * number of the process + number of the endpoint). The end of the input ends the process.
 *
 * Where PASSED_FOR names a directory, the process has a second participant, in that enclave, that writes 1999 on the
 * topic "owned" a few times. Then samples of the first endpoint are sent as if its were the writer's (forged_source.h).
 */
#define _GNU_SOURCE
#include <dds/dds.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cyclonedds_secure.h"
#include "forged_source.h"

enum { MOST_ENDPOINTS = 256, MOST_PARTITIONS = 16, MILLISECONDS = 20, SECONDS = 30, NUMBERS = 2000, OWNED = 1999, WRITTEN = 5 };

struct sample {
    uint32_t sender;
};
static const uint32_t sample_operations[] = {DDS_OP_ADR | DDS_OP_TYPE_4BY, offsetof(struct sample, sender), DDS_OP_RTS};
static const dds_topic_descriptor_t sample_type = {
    .m_size = sizeof(struct sample),
    .m_align = sizeof(uint32_t),
    .m_flagset = DDS_TOPIC_FIXED_SIZE,
    .m_typename = "Sample",
    .m_nops = 2,
    .m_ops = sample_operations,
    .m_meta = "",
};

struct endpoint {
    dds_entity_t entity;
    int publishes;
    unsigned char heard[NUMBERS];
};
static struct endpoint endpoints[MOST_ENDPOINTS];
static uint32_t count;
static dds_entity_t owner; /* the writer that the first endpoint passes for; 0: none */
static FILE *answers; /* the vendor writes to the standard output too, which becomes the error output */

/* Not more than two participants, whose ports both know. */
static void configure(const char *number, const char *first_port)
{
    char configuration[1024];
    snprintf(configuration, sizeof configuration,
             "<General><Interfaces><NetworkInterface address=\"127.0.0.1\" multicast=\"false\"/></Interfaces>"
             "<AllowMulticast>false</AllowMulticast></General>"
             "<Discovery><ParticipantIndex>%s</ParticipantIndex><MaxAutoParticipantIndex>1</MaxAutoParticipantIndex>"
             "<Peers><Peer address=\"127.0.0.1\"/></Peers><SPDPInterval>200ms</SPDPInterval>"
             "<Ports><Base>%s</Base><DomainGain>0</DomainGain></Ports></Discovery>"
             "<Tracing><Category>fatal,error,warning</Category><OutputFile>stderr</OutputFile></Tracing>",
             number, first_port);
    setenv("CYCLONEDDS_URI", configuration, 1);
}

static dds_entity_t create_endpoint(dds_entity_t participant, int publishes, const char *topic_name, uint32_t partitions,
                                    const char **names)
{
    dds_entity_t topic = dds_create_topic(participant, &sample_type, topic_name, NULL, NULL);
    if (topic < 0)
        return topic;
    dds_qos_t *qos = dds_create_qos();
    if (partitions > 0)
        dds_qset_partition(qos, partitions, names);
    dds_entity_t group =
        publishes ? dds_create_publisher(participant, qos, NULL) : dds_create_subscriber(participant, qos, NULL);
    dds_reset_qos(qos);
    dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 4);
    dds_qset_ignorelocal(qos, DDS_IGNORELOCAL_PARTICIPANT);
    dds_entity_t endpoint = group;
    if (group >= 0)
        endpoint = publishes ? dds_create_writer(group, topic, qos, NULL) : dds_create_reader(group, topic, qos, NULL);
    dds_delete_qos(qos);
    return endpoint;
}

static void create_endpoints(dds_entity_t participant, char **arguments)
{
    while (*arguments != NULL && count < MOST_ENDPOINTS) {
        struct endpoint *endpoint = &endpoints[count++];
        const char *partitions[MOST_PARTITIONS];
        endpoint->publishes = arguments[0][0] == 'P';
        const char *topic = arguments[1];
        uint32_t listed = (uint32_t)atoi(arguments[2]);
        arguments += 3;
        for (uint32_t i = 0; i < listed && i < MOST_PARTITIONS; i++)
            partitions[i] = *arguments++;
        endpoint->entity = create_endpoint(participant, endpoint->publishes, topic, listed, partitions);
        fputs(endpoint->entity < 0 ? "R\n" : "A\n", answers);
    }
}

static void write_as_owner(void)
{
    static int written;
    struct sample sample = {OWNED};
    dds_publication_matched_status_t status;
    if (owner > 0 && !forging && dds_get_publication_matched_status(owner, &status) == 0 && status.current_count > 0) {
        dds_write(owner, &sample);
        forging = ++written == WRITTEN;
    }
}

static void create_owner(dds_domainid_t domain, const char *directory, const char *library)
{
    dds_guid_t own, forged;
    dds_qos_t *qos = dds_create_qos();
    secure(qos, directory, library);
    dds_entity_t pp = dds_create_participant(domain, qos, NULL); fprintf(stderr,"PP %d %s\n",pp,dds_strretcode(pp));
    owner = create_endpoint(pp, 1, "owned", 0, NULL); fprintf(stderr,"W %d\n",owner);
    if (dds_get_guid(owner, &own) != 0 || dds_get_guid(endpoints[0].entity, &forged) != 0)
        abort();
    memcpy(owners_guid, own.v, sizeof owners_guid);
    memcpy(forgers_guid, forged.v, sizeof forgers_guid);
}

static void write_and_take(uint32_t number)
{
    write_as_owner();
    for (uint32_t i = 0; i < count; i++) {
        struct endpoint *endpoint = &endpoints[i];
        struct sample sample = {1000 * number + i};
        if (endpoint->entity < 0)
            continue;
        if (endpoint->publishes) {
            dds_publication_matched_status_t status;
            if (dds_get_publication_matched_status(endpoint->entity, &status) == 0 && status.current_count > 0)
                dds_write(endpoint->entity, &sample);
            continue;
        }
        void *samples[1] = {&sample};
        dds_sample_info_t info;
        while (dds_take(endpoint->entity, samples, &info, 1, 1) == 1)
            if (info.valid_data && sample.sender < NUMBERS)
                endpoint->heard[sample.sender] = 1;
    }
}

static uint32_t matched(const struct endpoint *endpoint)
{
    dds_publication_matched_status_t publication = {0};
    dds_subscription_matched_status_t subscription = {0};
    if (endpoint->entity < 0)
        return 0;
    if (endpoint->publishes) {
        dds_get_publication_matched_status(endpoint->entity, &publication);
        return publication.current_count;
    }
    dds_get_subscription_matched_status(endpoint->entity, &subscription);
    return subscription.current_count;
}

static void say_all(void)
{
    for (uint32_t i = 0; i < count; i++) {
        fprintf(answers, "%u", matched(&endpoints[i]));
        for (int sender = 0; sender < NUMBERS; sender++)
            if (endpoints[i].heard[sender])
                fprintf(answers, " %d", sender);
        fputc('\n', answers);
    }
    fflush(answers);
}

int main(int arguments, char **argument)
{
    if (arguments < 6)
        return 2;
    answers = fdopen(dup(STDOUT_FILENO), "w");
    if (answers == NULL || dup2(STDERR_FILENO, STDOUT_FILENO) < 0)
        return 1;
    alarm(SECONDS);
    configure(argument[1], argument[2]);
    dds_qos_t *qos = dds_create_qos();
    if (argument[4][0] != '\0')
        secure(qos, argument[4], argument[5]);
    dds_entity_t participant = dds_create_participant((dds_domainid_t)atoi(argument[3]), qos, NULL);
    fputs(participant < 0 ? "R\n" : "A\n", answers);
    if (participant >= 0)
        create_endpoints(participant, argument + 6);
    if (participant >= 0 && getenv("PASSED_FOR") != NULL)
        create_owner((dds_domainid_t)atoi(argument[3]), getenv("PASSED_FOR"), argument[5]);
    fflush(answers);
    struct pollfd input = {STDIN_FILENO, POLLIN, 0};
    for (;;) {
        char line[16];
        if (poll(&input, 1, MILLISECONDS) > 0) {
            if (read(STDIN_FILENO, line, sizeof line) <= 0)
                _exit(0);
            say_all();
        }
        write_and_take((uint32_t)atoi(argument[1]));
    }
}
