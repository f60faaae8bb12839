/* The properties that rmw_cyclonedds_cpp sets for an enclave. */
#include <dds/dds.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static const char *const FOLDERS[] = {
    "/usr/lib/x86_64-linux-gnu/libddsc0debian",
    "/usr/lib/aarch64-linux-gnu/libddsc0debian",
};

static void set_file(dds_qos_t *qos, const char *property, const char *directory, const char *file, int optional)
{
    char uri[PATH_MAX + 8];
    snprintf(uri, sizeof uri, "file:%s/%s", directory, file);
    if (!optional || access(uri + strlen("file:"), F_OK) == 0)
        dds_qset_prop(qos, property, uri);
}

static void set_library(dds_qos_t *qos, const char *plugin, const char *path, const char *functions)
{
    char property[80], value[80];
    snprintf(property, sizeof property, "dds.sec.%s.library.path", plugin);
    dds_qset_prop(qos, property, path);
    snprintf(property, sizeof property, "dds.sec.%s.library.init", plugin);
    snprintf(value, sizeof value, "init_%s", functions);
    dds_qset_prop(qos, property, value);
    snprintf(property, sizeof property, "dds.sec.%s.library.finalize", plugin);
    snprintf(value, sizeof value, "finalize_%s", functions);
    dds_qset_prop(qos, property, value);
}

static void set_installed(dds_qos_t *qos, const char *plugin, const char *library, const char *functions)
{
    char path[PATH_MAX];
    size_t i = 0;
    while (i + 1 < sizeof FOLDERS / sizeof *FOLDERS && access(FOLDERS[i], F_OK) != 0)
        i++;
    snprintf(path, sizeof path, "%s/libdds_security_%s.so", FOLDERS[i], library);
    set_library(qos, plugin, path, functions);
}

/* `library`: access control that stands in for the installed one; empty: none. */
static void secure(dds_qos_t *qos, const char *directory, const char *library)
{
    set_installed(qos, "auth", "auth", "authentication");
    set_installed(qos, "crypto", "crypto", "crypto");
    if (library[0] == '\0')
        set_installed(qos, "access", "ac", "access_control");
    else
        set_library(qos, "access", library, "access_control");
    set_file(qos, "dds.sec.auth.identity_ca", directory, "identity_ca.cert.pem", 0);
    set_file(qos, "dds.sec.auth.identity_certificate", directory, "cert.pem", 0);
    set_file(qos, "dds.sec.auth.private_key", directory, "key.pem", 0);
    set_file(qos, "dds.sec.access.permissions_ca", directory, "permissions_ca.cert.pem", 0);
    set_file(qos, "dds.sec.access.governance", directory, "governance.p7s", 0);
    set_file(qos, "dds.sec.access.permissions", directory, "permissions.p7s", 0);
    set_file(qos, "org.eclipse.cyclonedds.sec.auth.crl", directory, "crl.pem", 1);
}
