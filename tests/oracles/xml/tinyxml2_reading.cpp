/* What tinyxml2 reads in a document, asked for as Fast DDS asks: parse the octets in memory, take the first <dds>,
 * walk from element to element, take GetText() of those that hold no element.
 */
#include <tinyxml2.h>

#include <string>

extern "C" {
#include "document_stream.h"
}

static void append_reading(octets *reading, const char *kind, const std::string &path, const char *value)
{
    append_string(reading, kind);
    append_string(reading, path.c_str());
    append_string(reading, value == nullptr ? "" : value);
}

static void walk(const tinyxml2::XMLElement *element, const std::string &parent, octets *reading)
{
    const std::string path = parent + element->Name();
    const tinyxml2::XMLElement *child = element->FirstChildElement();
    append_reading(reading, child == nullptr ? "V" : "E", path, child == nullptr ? element->GetText() : "");
    for (const tinyxml2::XMLAttribute *a = element->FirstAttribute(); a != nullptr; a = a->Next())
        append_reading(reading, "A", path + "@" + a->Name(), a->Value());
    for (; child != nullptr; child = child->NextSiblingElement())
        walk(child, path + "/", reading);
}

int main()
{
    octets document = {nullptr, 0, 0}, reading = {nullptr, 0, 0};
    while (next_document(&document)) {
        reading.length = 0;
        tinyxml2::XMLDocument parsed;
        const tinyxml2::XMLElement *root = nullptr;
        if (parsed.Parse(document.start, document.length) != tinyxml2::XML_SUCCESS)
            append_reading(&reading, "R", "", parsed.ErrorName());
        else if ((root = parsed.FirstChildElement("dds")) == nullptr)
            append_reading(&reading, "R", "", "no <dds>");
        else
            walk(root, "", &reading);
        answer(stdout, &reading);
    }
    return 0;
}
