// The packet network of skinnet as ns-3 models it: point-to-point devices with drop-tail queues, and static
// routes at every node. Reads the files of `skinnet network simulate`, writes which packet arrived when.
//
// Build (Debian: apt-get install g++ libns3-dev):
//     g++ -O2 -std=c++17 skin_network.cc -o skin_network -lns3-point-to-point -lns3-network -lns3-core
// Use:
//     skin_network LINKS.csv PACKETS.csv ROUTES.csv UNTIL_NS DELIVERED.csv DROPS.csv COUNTERS.csv
//
// Columns stand in the order src,src_port,dst,dst_port,bits_per_s,bits_per_byte,delay_ns,queue_packets /
// id,t_ns,node,dest,size_bytes / node,dest,src_port. COUNTERS.csv has packets,bytes,queue_high_water of every
// link, in the order of LINKS.csv; a packet that is sent at once counts as having been in the queue.
// The line on standard output is the CPU time of the event loop and the number of hops: "cpu_s=… hops=…".
//
// ns-3 sends eight bits a byte, so the rate of a device is bits_per_s * 8 / bits_per_byte, which must be
// whole. A packet carries its number, destination and hops so far in a header, as every forwarding protocol
// of ns-3 does; these nine bytes and the two of the device's PPP header are part of its size, not on top of it.
// A DropTailQueue of n packets holds n behind the one in transmission, with n >= 1.

#include "ns3/core-module.h"
#include "ns3/network-module.h"
#include "ns3/point-to-point-channel.h"
#include "ns3/point-to-point-net-device.h"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <unordered_map>
#include <vector>

using namespace ns3;

namespace
{
constexpr uint32_t PPP_BYTES = 2;
constexpr uint8_t HOP_LIMIT = 255;
constexpr uint16_t IPV4 = 0x0800; // the PPP header knows IP only
constexpr int64_t UNBOUNDED = -1;

using Row = std::vector<int64_t>;

struct Offered
{
    int64_t id, t_ns;
    uint32_t node, dest, size;
};

struct End
{
    int64_t id, t_ns, node;
};

class SkinHeader : public Header
{
  public:
    static constexpr uint32_t BYTES = 9;
    uint32_t number = 0, dest = 0; // positions in `offered` and `nodes`
    uint8_t hops = 0;

    static TypeId GetTypeId()
    {
        static TypeId id = TypeId("SkinHeader").SetParent<Header>().AddConstructor<SkinHeader>();
        return id;
    }

    TypeId GetInstanceTypeId() const override
    {
        return GetTypeId();
    }

    uint32_t GetSerializedSize() const override
    {
        return BYTES;
    }

    void Serialize(Buffer::Iterator to) const override
    {
        to.WriteU32(number);
        to.WriteU32(dest);
        to.WriteU8(hops);
    }

    uint32_t Deserialize(Buffer::Iterator from) override
    {
        number = from.ReadU32();
        dest = from.ReadU32();
        hops = from.ReadU8();
        return BYTES;
    }

    void Print(std::ostream& out) const override
    {
        out << number << " to " << dest << " after " << int(hops);
    }
};

struct Counters
{
    uint64_t packets = 0, bytes = 0;
    uint32_t queue_high_water = 0;
};

struct Forwarder
{
    int64_t number;
    Ptr<Node> node;
    std::unordered_map<int64_t, Ptr<PointToPointNetDevice>> port;
    std::vector<PointToPointNetDevice*> ahead; // by destination
};

std::vector<Offered> offered;
std::vector<Forwarder> nodes;
std::unordered_map<int64_t, uint32_t> index_of;
std::vector<End> delivered, dropped;
std::vector<Counters> counters; // by link
size_t next_offered = 0;
int64_t until_ns = 0;
Address broadcast;

[[noreturn]] void
Fail(const std::string& what)
{
    std::cerr << "skin_network: " << what << "\n";
    std::exit(2);
}

std::vector<Row>
Read(const char* path, size_t columns)
{
    std::ifstream file(path);
    if (!file)
        Fail(std::string("cannot read ") + path);
    std::vector<Row> rows;
    std::string line, field;
    std::getline(file, line);
    while (std::getline(file, line))
    {
        Row row;
        std::istringstream fields(line);
        while (std::getline(fields, field, ','))
            row.push_back(field.empty() ? UNBOUNDED : std::stoll(field));
        if (row.size() + 1 == columns)
            row.push_back(UNBOUNDED); // an empty last field
        if (row.size() != columns)
            Fail(std::string(path) + ": " + line);
        rows.push_back(row);
    }
    return rows;
}

void
Finish(std::vector<End>& ends, uint32_t number, uint32_t at)
{
    ends.push_back({offered[number].id, Simulator::Now().GetNanoSeconds(), nodes[at].number});
}

void
Forward(Ptr<Packet> packet, const SkinHeader& header, uint32_t at)
{
    if (header.dest == at)
    {
        Finish(delivered, header.number, at);
        return;
    }
    PointToPointNetDevice* device = nodes[at].ahead[header.dest];
    packet->AddHeader(header);
    if (header.hops >= HOP_LIMIT || device == nullptr || !device->Send(packet, broadcast, IPV4))
        Finish(dropped, header.number, at);
}

void
Receive(uint32_t at, Ptr<NetDevice>, Ptr<const Packet> packet, uint16_t, const Address&,
        const Address&, NetDevice::PacketType)
{
    Ptr<Packet> copy = packet->Copy();
    SkinHeader header;
    copy->RemoveHeader(header);
    ++header.hops;
    Forward(copy, header, at);
}

void
Enter()
{
    SkinHeader header;
    header.number = next_offered++;
    const Offered& what = offered[header.number];
    header.dest = what.dest;
    if (next_offered < offered.size() && offered[next_offered].t_ns < until_ns)
        Simulator::Schedule(NanoSeconds(offered[next_offered].t_ns - what.t_ns), &Enter);
    Forward(Create<Packet>(what.size - PPP_BYTES - SkinHeader::BYTES), header, what.node);
}

uint32_t
NodeOf(int64_t number)
{
    auto [entry, fresh] = index_of.try_emplace(number, nodes.size());
    const uint32_t at = entry->second;
    if (fresh)
    {
        nodes.push_back({number, CreateObject<Node>(), {}, {}});
        nodes[at].node->RegisterProtocolHandler(MakeBoundCallback(&Receive, at), IPV4, nullptr);
    }
    return at;
}

void
CountArrival(size_t link, Ptr<const Packet> packet)
{
    counters[link].packets += 1;
    counters[link].bytes += packet->GetSize();
}

void
CountQueue(size_t link, uint32_t, uint32_t waiting)
{
    counters[link].queue_high_water = std::max(counters[link].queue_high_water, waiting);
}

Ptr<PointToPointNetDevice>
Device(uint32_t at, int64_t queue_packets)
{
    auto queue = CreateObject<DropTailQueue<Packet>>();
    queue->SetMaxSize(QueueSize(QueueSizeUnit::PACKETS, queue_packets == UNBOUNDED ? UINT32_MAX : queue_packets));
    auto device = CreateObject<PointToPointNetDevice>();
    device->SetAddress(Mac48Address::Allocate());
    device->SetQueue(queue);
    nodes[at].node->AddDevice(device);
    return device;
}

void
Wire(const Row& row)
{
    const int64_t bits_per_s = row[4] * 8;
    if (bits_per_s % row[5] != 0 || row[7] == 0)
        Fail("a rate or a queue that ns-3 cannot represent");
    const uint32_t src = NodeOf(row[0]), dst = NodeOf(row[2]);
    auto channel = CreateObject<PointToPointChannel>();
    channel->SetAttribute("Delay", TimeValue(NanoSeconds(row[6])));
    auto near = Device(src, row[7]), far = Device(dst, 1);
    near->SetDataRate(DataRate(bits_per_s / row[5]));
    near->Attach(channel);
    far->Attach(channel);
    nodes[src].port[row[1]] = near;
    far->TraceConnectWithoutContext("PhyRxEnd", MakeBoundCallback(&CountArrival, counters.size()));
    near->GetQueue()->TraceConnectWithoutContext("PacketsInQueue",
                                                 MakeBoundCallback(&CountQueue, counters.size()));
    counters.emplace_back();
}

void
Write(const char* path, const char* header, const std::vector<End>& ends, bool with_node)
{
    std::ofstream file(path);
    file << header << "\n";
    for (const End& end : ends)
    {
        file << end.id << "," << end.t_ns;
        if (with_node)
            file << "," << end.node;
        file << "\n";
    }
}
} // namespace

int
main(int argc, char* argv[])
{
    if (argc != 8)
        Fail("LINKS.csv PACKETS.csv ROUTES.csv UNTIL_NS DELIVERED.csv DROPS.csv COUNTERS.csv");
    until_ns = std::stoll(argv[4]);
    for (const Row& row : Read(argv[1], 8))
        Wire(row);
    for (const Row& row : Read(argv[2], 5))
    {
        if (row[4] < int64_t(PPP_BYTES + SkinHeader::BYTES))
            Fail("a packet smaller than its headers");
        offered.push_back({row[0], row[1], NodeOf(row[2]), NodeOf(row[3]), uint32_t(row[4])});
    }
    for (const Row& row : Read(argv[3], 3))
    {
        const uint32_t at = NodeOf(row[0]), dest = NodeOf(row[1]);
        nodes[at].ahead.resize(nodes.size());
        nodes[at].ahead[dest] = PeekPointer(nodes[at].port.at(row[2]));
    }
    for (Forwarder& node : nodes)
        node.ahead.resize(nodes.size());
    broadcast = Mac48Address::GetBroadcast();

    if (!offered.empty() && offered[0].t_ns < until_ns)
        Simulator::Schedule(NanoSeconds(offered[0].t_ns), &Enter);
    Simulator::Stop(NanoSeconds(until_ns));
    const std::clock_t start = std::clock();
    Simulator::Run();
    const double cpu_s = double(std::clock() - start) / CLOCKS_PER_SEC;

    Write(argv[5], "id,t_delivered_ns", delivered, false);
    Write(argv[6], "id,t_ns,node", dropped, true);
    std::ofstream file(argv[7]);
    file << "packets,bytes,queue_high_water\n";
    uint64_t hops = 0;
    for (const Counters& link : counters)
    {
        hops += link.packets;
        file << link.packets << "," << link.bytes << "," << link.queue_high_water << "\n";
    }
    std::printf("cpu_s=%.6f hops=%llu\n", cpu_s, static_cast<unsigned long long>(hops));
    Simulator::Destroy();
    return 0;
}
