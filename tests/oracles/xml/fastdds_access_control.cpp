/* Fast DDS's own plugins, asked without a network, as cyclone_access_control.c asks those of Cyclone DDS: the same
 * documents in (the identity is certificate and private key in one PEM), the same answer out. They read files alone,
 * which go into the directory that the argument names. The factory of the plugins is exported and not declared.
 */
#include <fastdds/rtps/attributes/RTPSParticipantAttributes.h>
#include <fastdds/rtps/security/accesscontrol/AccessControl.h>
#include <fastdds/rtps/security/accesscontrol/EndpointSecurityAttributes.h>
#include <fastdds/rtps/security/authentication/Authentication.h>
#include <fastdds/rtps/security/exceptions/SecurityException.h>
#include <unistd.h>

#include <fstream>
#include <memory>
#include <sstream>

extern "C" {
#include "document_stream.h"
}

using namespace eprosima::fastrtps::rtps;
using namespace eprosima::fastrtps::rtps::security;

namespace eprosima {
namespace fastrtps {
namespace rtps {
namespace security {
class SecurityPluginFactory
{
public:
    Authentication *create_authentication_plugin(const PropertyPolicy &properties);
    AccessControl *create_access_control_plugin(const PropertyPolicy &properties);
};
} // namespace security
} // namespace rtps
} // namespace fastrtps
} // namespace eprosima

static const char AUTHENTICATION[] = "dds.sec.auth.builtin.PKI-DH.";
static const char ACCESS[] = "dds.sec.access.builtin.Access-Permissions.";

/* Takes a document into a file, if it is another than last time. */
static bool next_file(const std::string &path, std::string &last, bool *is_new)
{
    octets content = {nullptr, 0, 0};
    if (!next_document(&content))
        return false;
    const std::string now(content.start, content.length);
    free(content.start);
    if (now != last) {
        std::ofstream(path, std::ios::binary) << now;
        last = now;
        *is_new = true;
    }
    return true;
}

static void add_topic(AccessControl &access, const PermissionsHandle &handle, int domain, const std::string &topic,
                      octets *reading)
{
    SecurityException ignored;
    EndpointSecurityAttributes rule;
    const std::vector<std::string> partitions;
    char flags[16] = "x";
    if (access.get_datawriter_sec_attributes(handle, topic, partitions, rule, ignored)) {
        const bool writes = access.check_create_datawriter(handle, domain, topic, partitions, ignored);
        const bool reads = access.check_create_datareader(handle, domain, topic, partitions, ignored);
        snprintf(flags, sizeof flags, "%c%c%d%d%d%d", writes ? 'w' : '-', reads ? 'r' : '-', rule.is_read_protected,
                 rule.is_write_protected, rule.is_discovery_protected, rule.is_liveliness_protected);
    }
    append_string(reading, "T");
    append_string(reading, topic.c_str());
    append_string(reading, flags);
}

static void refuse(octets *reading, const char *who, const SecurityException &why)
{
    append_string(reading, "R");
    append_string(reading, who);
    append_string(reading, why.what() == nullptr ? "" : why.what());
}

int main(int count, char **arguments)
{
    if (count != 2)
        return 2;
    const std::string directory = std::string(arguments[1]) + "/";
    FILE *answers = fdopen(dup(STDOUT_FILENO), "w");
    if (answers == nullptr || dup2(STDERR_FILENO, STDOUT_FILENO) < 0)
        return 1;
    RTPSParticipantAttributes participant;
    const std::pair<std::string, std::string> properties[] = {
        {"dds.sec.auth.plugin", "builtin.PKI-DH"},
        {"dds.sec.access.plugin", "builtin.Access-Permissions"},
        {AUTHENTICATION + std::string("identity_ca"), "file://" + directory + "ca.pem"},
        {AUTHENTICATION + std::string("identity_certificate"), "file://" + directory + "identity.pem"},
        {AUTHENTICATION + std::string("private_key"), "file://" + directory + "identity.pem"},
        {ACCESS + std::string("permissions_ca"), "file://" + directory + "ca.pem"},
        {ACCESS + std::string("governance"), "file://" + directory + "governance.p7s"},
        {ACCESS + std::string("permissions"), "file://" + directory + "permissions.p7s"},
    };
    for (const auto &property : properties)
        participant.properties.properties().emplace_back(property.first, property.second);
    SecurityPluginFactory factory;
    std::unique_ptr<Authentication> authentication(factory.create_authentication_plugin(participant.properties));
    IdentityHandle *identity = nullptr;
    std::string ca, credentials, governance, permissions;
    octets number = {nullptr, 0, 0}, topics = {nullptr, 0, 0}, reading = {nullptr, 0, 0};
    for (;;) {
        bool is_new = false, other_document = false;
        if (!next_file(directory + "ca.pem", ca, &is_new) ||
            !next_file(directory + "identity.pem", credentials, &is_new) ||
            !next_file(directory + "governance.p7s", governance, &other_document) ||
            !next_file(directory + "permissions.p7s", permissions, &other_document) || !next_document(&number) ||
            !next_document(&topics))
            return 0;
        alarm(20); /* a document on which it hangs ends the process, as one that crashes it does */
        reading.length = 0;
        const int domain = atoi(number.start);
        SecurityException why;
        if (is_new) {
            GUID_t adjusted, candidate;
            candidate.guidPrefix.value[0] = 1;
            candidate.entityId = c_EntityId_RTPSParticipant;
            if (authentication->validate_local_identity(&identity, adjusted, domain, participant, candidate, why) !=
                VALIDATION_OK)
                return 1;
        }
        std::unique_ptr<AccessControl> access(factory.create_access_control_plugin(participant.properties));
        PermissionsHandle *handle =
            access->validate_local_permissions(*authentication, *identity, domain, participant, why);
        if (handle == nullptr || handle->nil())
            refuse(&reading, "permissions", why);
        else if (!access->check_create_participant(*handle, domain, participant, why))
            refuse(&reading, "participant", why);
        else {
            append(&reading, "A\0\0", 4);
            std::istringstream lines(topics.start);
            for (std::string topic; std::getline(lines, topic);)
                add_topic(*access, *handle, domain, topic, &reading);
        }
        if (handle != nullptr)
            access->return_permissions_handle(handle, why);
        alarm(0);
        answer(answers, &reading);
    }
}
