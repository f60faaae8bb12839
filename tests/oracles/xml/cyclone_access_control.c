/* Cyclone DDS's own access control plugin, asked without a network: does a participant start with these two signed
 * documents, and what may it do? Debian builds it as libdds_security_ac.so; its header is <dds/security/...>.
 *
 * In, each as a document of document_stream.h: permissions CA (PEM), identity certificate (PEM), governance,
 * permissions (both S/MIME), domain (digits), topics (one a line). Out: R, code, message; or A (accepted), "", "",
 * then for each topic its name and flags: w (may write) and r (may read) or -, then 1 or 0 for read and write
 * access control, discovery and liveliness protection, or x for a topic without a rule.
 */
#include <dds/security/dds_security_api.h>
#include <dlfcn.h>
#include <unistd.h>

#include "document_stream.h"

static const char *const LIBRARIES[] = {
    "libdds_security_ac.so",
    "/usr/lib/x86_64-linux-gnu/libddsc0debian/libdds_security_ac.so",
    "/usr/lib/aarch64-linux-gnu/libddsc0debian/libdds_security_ac.so",
};

/* The plugin keeps a pointer into its domain for timers, which nothing here starts. */
static char domain_stand_in[1 << 20];

static DDS_Security_boolean get_identity_token(dds_security_authentication *instance, DDS_Security_IdentityToken *token,
                                               const DDS_Security_IdentityHandle handle,
                                               DDS_Security_SecurityException *ex)
{
    (void)instance, (void)handle, (void)ex;
    memset(token, 0, sizeof *token);
    token->class_id = strdup("DDS:Auth:PKI-DH:1.0");
    token->properties._length = token->properties._maximum = 1;
    token->properties._buffer = calloc(1, sizeof(DDS_Security_Property_t));
    token->properties._buffer[0].name = strdup("dds.cert.sn");
    token->properties._buffer[0].value = strdup("CN=/talker");
    return 1;
}

/* An instance keeps the first rights it was given, so every pair of documents gets a new one. */
static int (*init)(const char *, void **, struct ddsi_domaingv *);
static int (*finalize)(void *);

static void load(void)
{
    void *library = NULL;
    for (size_t i = 0; library == NULL && i < sizeof LIBRARIES / sizeof *LIBRARIES; i++)
        library = dlopen(LIBRARIES[i], RTLD_NOW);
    if (library != NULL) {
        *(void **)&init = dlsym(library, "init_access_control");
        *(void **)&finalize = dlsym(library, "finalize_access_control");
    }
    if (init == NULL || finalize == NULL) {
        fprintf(stderr, "no access control plugin of Cyclone DDS: %s\n", dlerror());
        exit(77);
    }
}

static int next_property(DDS_Security_Property_t *property, const char *name)
{
    static const char scheme[] = "data:,";
    struct octets content = {NULL, 0, 0}, uri = {NULL, 0, 0};
    if (!next_document(&content))
        return 0;
    append(&uri, scheme, sizeof scheme - 1);
    append(&uri, content.start, content.length + 1);
    free(content.start);
    free(property->value);
    property->name = (char *)name;
    property->value = uri.start;
    return 1;
}

static void add_topic(dds_security_access_control *ac, DDS_Security_PermissionsHandle handle, int domain,
                      const DDS_Security_Qos *qos, const char *topic, struct octets *reading)
{
    DDS_Security_SecurityException ex;
    DDS_Security_PartitionQosPolicy partition;
    DDS_Security_DataTags tags;
    DDS_Security_TopicSecurityAttributes rule;
    memset(&ex, 0, sizeof ex);
    memset(&partition, 0, sizeof partition);
    memset(&tags, 0, sizeof tags);
    memset(&rule, 0, sizeof rule);
    int writes = ac->check_create_datawriter(ac, handle, domain, topic, qos, &partition, &tags, &ex);
    int reads = ac->check_create_datareader(ac, handle, domain, topic, qos, &partition, &tags, &ex);
    char flags[16];
    if (ac->get_topic_sec_attributes(ac, handle, topic, &rule, &ex))
        snprintf(flags, sizeof flags, "%c%c%d%d%d%d", writes ? 'w' : '-', reads ? 'r' : '-', rule.is_read_protected,
                 rule.is_write_protected, rule.is_discovery_protected, rule.is_liveliness_protected);
    else
        snprintf(flags, sizeof flags, "x");
    append_string(reading, "T");
    append_string(reading, topic);
    append_string(reading, flags);
}

int main(void)
{
    static const char *const names[] = {"dds.sec.access.permissions_ca", "dds.sec.auth.identity_certificate",
                                        "dds.sec.access.governance", "dds.sec.access.permissions"};
    enum { PROPERTIES = sizeof names / sizeof *names, SECONDS = 20 };
    /* The plugin prints its complaints: what it writes to the standard output goes to the error output. */
    FILE *answers = fdopen(dup(STDOUT_FILENO), "w");
    if (answers == NULL || dup2(STDERR_FILENO, STDOUT_FILENO) < 0)
        return 1;
    load();
    dds_security_authentication authentication;
    memset(&authentication, 0, sizeof authentication);
    authentication.get_identity_token = get_identity_token;
    DDS_Security_Property_t properties[PROPERTIES];
    memset(properties, 0, sizeof properties);
    DDS_Security_Qos qos;
    memset(&qos, 0, sizeof qos);
    qos.property.value._length = qos.property.value._maximum = PROPERTIES;
    qos.property.value._buffer = properties;
    struct octets number = {NULL, 0, 0}, topics = {NULL, 0, 0}, reading = {NULL, 0, 0};
    for (;;) {
        for (int i = 0; i < PROPERTIES; i++)
            if (!next_property(&properties[i], names[i]))
                return 0;
        if (!next_document(&number) || !next_document(&topics))
            return 0;
        void *context = NULL;
        if (init("", &context, (struct ddsi_domaingv *)domain_stand_in) != 0)
            return 1;
        dds_security_access_control *ac = context;
        reading.length = 0;
        alarm(SECONDS); /* a document on which the plugin hangs ends the process, as one that crashes it does */
        int domain = atoi(number.start);
        DDS_Security_SecurityException ex;
        memset(&ex, 0, sizeof ex);
        DDS_Security_PermissionsHandle handle =
            ac->validate_local_permissions(ac, &authentication, 1, domain, &qos, &ex);
        if (handle == 0 || !ac->check_create_participant(ac, handle, domain, &qos, &ex)) {
            char code[16];
            snprintf(code, sizeof code, "%d", ex.code);
            append_string(&reading, "R");
            append_string(&reading, code);
            append_string(&reading, ex.message != NULL ? ex.message : "");
            if (handle != 0)
                ac->return_permissions_handle(ac, handle, &ex);
        } else {
            append(&reading, "A\0\0", 4);
            for (char *topic = strtok(topics.start, "\n"); topic != NULL; topic = strtok(NULL, "\n"))
                add_topic(ac, handle, domain, &qos, topic, &reading);
            ac->return_permissions_handle(ac, handle, &ex);
        }
        finalize(context);
        alarm(0);
        answer(answers, &reading);
    }
}
