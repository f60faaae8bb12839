// The properties that rmw_fastrtps_cpp sets for an enclave.
#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>
#include <string>
#include <unistd.h>

static void secure(eprosima::fastdds::dds::DomainParticipantQos &qos, const std::string &directory)
{
    static const std::string authentication = "dds.sec.auth.builtin.PKI-DH.",
                             access_control = "dds.sec.access.builtin.Access-Permissions.";
    auto &properties = qos.properties().properties();
    const auto file = [&](const std::string &property, const std::string &name) {
        properties.emplace_back(property, "file://" + directory + "/" + name);
    };
    properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
    file(authentication + "identity_ca", "identity_ca.cert.pem");
    file(authentication + "identity_certificate", "cert.pem");
    file(authentication + "private_key", "key.pem");
    properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
    properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
    file(access_control + "permissions_ca", "permissions_ca.cert.pem");
    file(access_control + "governance", "governance.p7s");
    file(access_control + "permissions", "permissions.p7s");
    if (access((directory + "/crl.pem").c_str(), F_OK) == 0)
        file(authentication + "identity_crl", "crl.pem");
}
