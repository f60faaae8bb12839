/* Fast DDS itself, asked through its public API as cyclonedds_enclave.c asks Cyclone DDS: the same documents in, the
 * same answer out. The properties are those that rmw_fastrtps_cpp sets. UDP on the loopback interface alone, and the
 * only peer is its discard port.
 */
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <memory>
#include <mutex>
#include <vector>

#include "fastdds_secure.hpp"

extern "C" {
#include "document_stream.h"
}

using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;

/* Nothing is sent, so nothing is written out. */
class Text : public TopicDataType
{
public:
    Text()
    {
        setName("Text");
        m_typeSize = 16;
        m_isGetKeyDefined = false;
    }
    bool serialize(void *, SerializedPayload_t *) override { return false; }
    bool deserialize(SerializedPayload_t *, void *) override { return false; }
    std::function<uint32_t()> getSerializedSizeProvider(void *) override
    {
        return [] { return 16u; };
    }
    void *createData() override { return new char[16]; }
    void deleteData(void *data) override { delete[] static_cast<char *>(data); }
    bool getKey(void *, InstanceHandle_t *, bool) override { return false; }
};

/* The first complaint since the last answer: later ones only say what follows from it. */
static std::mutex guard;
static std::string complaint;

class Complaints : public LogConsumer
{
    void Consume(const Log::Entry &entry) override
    {
        const std::lock_guard<std::mutex> held(guard);
        if (complaint.empty() && entry.kind == Log::Kind::Error)
            complaint = entry.message.substr(0, entry.message.find('\n'));
    }
};

static void say(octets *reading, const char *what)
{
    Log::Flush();
    const std::lock_guard<std::mutex> held(guard);
    append_string(reading, what);
    append_string(reading, complaint.c_str());
    complaint.clear();
}

static uint16_t free_port()
{
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof address;
    const int probe = socket(AF_INET, SOCK_DGRAM, 0);
    if (bind(probe, reinterpret_cast<sockaddr *>(&address), length) != 0 ||
        getsockname(probe, reinterpret_cast<sockaddr *>(&address), &length) != 0)
        abort();
    close(probe);
    return ntohs(address.sin_port);
}

static Locator_t loopback(uint16_t port)
{
    Locator_t locator;
    IPLocator::setIPv4(locator, "127.0.0.1");
    locator.port = port;
    return locator;
}

static DomainParticipant *create_participant(uint32_t domain, const std::string &directory)
{
    DomainParticipantQos qos;
    secure(qos, directory);
    const auto transport = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    transport->interfaceWhiteList.push_back("127.0.0.1");
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(transport);
    /* Ports of its own: those of the standard belong to others in the domain, and there is none after a while, since
       every participant of a process gets a number. */
    qos.wire_protocol().port.participantIDGain = 0;
    qos.wire_protocol().builtin.metatrafficUnicastLocatorList.push_back(loopback(free_port()));
    qos.wire_protocol().default_unicast_locator_list.push_back(loopback(free_port()));
    qos.wire_protocol().builtin.initialPeersList.push_back(loopback(9));
    return DomainParticipantFactory::get_instance()->create_participant(domain, qos);
}

static void try_endpoint(DomainParticipant &participant, octets *reading, bool publishes, const std::string &topic_name,
                         const std::vector<std::string> &partitions)
{
    Topic *topic = participant.create_topic(topic_name, "Text", TOPIC_QOS_DEFAULT);
    if (topic == nullptr)
        return say(reading, "topic");
    PartitionQosPolicy names;
    for (const std::string &partition : partitions)
        names.push_back(partition.c_str());
    const char *where = "group";
    if (publishes) {
        PublisherQos qos;
        qos.partition() = names;
        if (Publisher *publisher = participant.create_publisher(qos)) {
            DataWriter *writer = publisher->create_datawriter(topic, DATAWRITER_QOS_DEFAULT);
            where = writer == nullptr ? "endpoint" : "A";
            publisher->delete_contained_entities();
            participant.delete_publisher(publisher);
        }
    } else {
        SubscriberQos qos;
        qos.partition() = names;
        if (Subscriber *subscriber = participant.create_subscriber(qos)) {
            DataReader *reader = subscriber->create_datareader(topic, DATAREADER_QOS_DEFAULT);
            where = reader == nullptr ? "endpoint" : "A";
            subscriber->delete_contained_entities();
            participant.delete_subscriber(subscriber);
        }
    }
    participant.delete_topic(topic);
    say(reading, where);
}

static void try_endpoints(DomainParticipant &participant, octets *reading, const octets &endpoints)
{
    const char *at = endpoints.start, *end = at + endpoints.length;
    const auto next = [&at] {
        const std::string text(at);
        at += text.size() + 1;
        return text;
    };
    while (at < end) {
        const bool publishes = next() == "P";
        const std::string topic = next();
        std::vector<std::string> partitions;
        for (int count = std::stoi(next()); count > 0; count--)
            partitions.push_back(next());
        try_endpoint(participant, reading, publishes, topic, partitions);
    }
}

int main()
{
    FILE *answers = fdopen(dup(STDOUT_FILENO), "w");
    if (answers == nullptr || dup2(STDERR_FILENO, STDOUT_FILENO) < 0)
        return 1;
    Log::ClearConsumers();
    Log::RegisterConsumer(std::unique_ptr<LogConsumer>(new Complaints));
    octets directory = {nullptr, 0, 0}, domain = {nullptr, 0, 0}, endpoints = {nullptr, 0, 0}, reading = {nullptr, 0, 0};
    while (next_document(&directory) && next_document(&domain) && next_document(&endpoints)) {
        alarm(20); /* a keystore on which it hangs ends the process, as one that crashes it does */
        reading.length = 0;
        DomainParticipant *participant =
            create_participant(static_cast<uint32_t>(atoi(domain.start)), directory.start);
        say(&reading, participant == nullptr ? "R" : "A");
        if (participant != nullptr) {
            TypeSupport(new Text).register_type(participant);
            try_endpoints(*participant, &reading, endpoints);
            participant->delete_contained_entities();
            DomainParticipantFactory::get_instance()->delete_participant(participant);
        }
        {
            Log::Flush();
            const std::lock_guard<std::mutex> held(guard);
            complaint.clear(); /* what is said while things are deleted */
        }
        alarm(0);
        answer(answers, &reading);
    }
    return 0;
}
