// A foreign master for the tests: the MasterController of vda-5050-lib sends every car its share of deliveries.
// node vda_5050_lib_master.js BROKER_URL LIF_FILE N_CARS N_ORDERS; says what it has counted when all are processed.
const fs = require("fs");
const { MasterController, createUuid } = require("vda-5050-lib");

const [brokerUrl, lifFile, nCars, nOrders] = process.argv.slice(2);
const layout = JSON.parse(fs.readFileSync(lifFile, "utf8")).layouts[0];
const places = {};
for (const node of layout.nodes) {
  const theta = node.vehicleTypeNodeProperties[0].theta;
  places[node.nodeId] = { ...node.nodePosition, theta, mapId: process.env.MAP_ID };
}
const stations = { pick: [], drop: [] };
for (const station of layout.stations) {
  const node = layout.nodes.find((one) => one.nodeId === station.interactionNodeIds[0]);
  for (const action of node.vehicleTypeNodeProperties[0].actions || []) {
    if (stations[action.actionType]) stations[action.actionType].push({ name: station.stationId, node: node.nodeId, busy: false });
  }
}
const told = { processed: 0, errors: [], invalid: 0, seen: {}, picked: 0, dropped: 0, traversed: 0, cancelled: 0 };
console.error = (...words) => { told.invalid += 1; told.lastInvalid = words.map(String).join(" ").slice(0, 300); };

(async () => {
  const master = new MasterController(
    { interfaceName: "uagv", transport: { brokerUrl }, vdaVersion: "2.0.0" },
    { targetAgvs: { manufacturer: "fleet" } });
  await master.start();
  const homes = {};
  let given = 0;
  const idle = [];
  const next = () => {
    while (idle.length && given < Number(nOrders)) {
      const pick = stations.pick.find((one) => !one.busy);
      const drop = stations.drop.find((one) => !one.busy);
      if (!pick || !drop) return;
      pick.busy = drop.busy = true;
      stations.pick.push(stations.pick.splice(stations.pick.indexOf(pick), 1)[0]);
      stations.drop.push(stations.drop.splice(stations.drop.indexOf(drop), 1)[0]);
      deliver(idle.shift(), pick, drop, given++);
    }
  };
  const action = (actionType, loadId) => ({
    actionType, actionId: createUuid(), blockingType: "HARD", actionParameters: [{ key: "loadId", value: loadId }] });
  const deliver = (serialNumber, pick, drop, number) => {
    const home = homes[serialNumber];
    const loadId = `parcel ${number}`;
    const stops = [
      { nodeId: createUuid(), nodePosition: home, actions: [] },
      { nodeId: createUuid(), nodePosition: places[pick.node], actions: [action("pick", loadId)] },
      { nodeId: createUuid(), nodePosition: places[drop.node], actions: [action("drop", loadId)] },
      { nodeId: createUuid(), nodePosition: home, actions: [] },
    ];
    const nodes = stops.map((stop, k) => ({ ...stop, sequenceId: 2 * k, released: true }));
    const edges = nodes.slice(1).map((end, k) => ({
      edgeId: createUuid(), sequenceId: 2 * k + 1, released: true, actions: [],
      startNodeId: nodes[k].nodeId, endNodeId: end.nodeId }));
    const order = { orderId: createUuid(), orderUpdateId: 0, nodes, edges };
    master.assignOrder({ manufacturer: "fleet", serialNumber }, order, {
      onNodeTraversed: (node) => {
        told.traversed += 1;
        if (node === nodes[3]) drop.busy = false;
        next();
      },
      onEdgeTraversing: (edge) => {
        if (edge === edges[1]) pick.busy = false;
        if (edge === edges[2]) drop.busy = false;
        next();
      },
      onActionStateChanged: (state, error, one) => {
        if (state.actionStatus === "FAILED") told.errors.push(`${one.actionType} failed: ${state.resultDescription}`);
        if (state.actionStatus === "FINISHED") told[one.actionType === "pick" ? "picked" : "dropped"] += 1;
      },
      onOrderProcessed: (error, byCancelation, active, context) => {
        if (active) return;
        if (error) told.errors.push(`${error.errorType}: ${error.errorDescription}`);
        if (byCancelation) told.cancelled += 1;
        told.processed += 1;
        pick.busy = drop.busy = false;
        idle.push(serialNumber);
        if (told.processed === Number(nOrders)) {
          console.log("result", JSON.stringify(told));
          master.stop().then(() => process.exit(0));
        } else next();
      },
    });
  };
  await master.subscribe("state", { manufacturer: "fleet" }, (state) => {
    if (homes[state.serialNumber]) return;
    const { x, y, theta, mapId } = state.agvPosition;
    homes[state.serialNumber] = { x, y, theta, mapId };
    idle.push(state.serialNumber);
    if (Object.keys(homes).length === Number(nCars)) next();
  });
})();
