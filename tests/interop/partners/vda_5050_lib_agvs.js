// Foreign vehicles for the tests: virtual AGVs of vda-5050-lib, each at its pose; says `ready` when all are online.
// node vda_5050_lib_agvs.js BROKER_URL MAP_ID TIME_LAPSE POSES; POSES is JSON, [[x, y, theta], ...].
const { AgvController, VirtualAgvAdapter } = require("vda-5050-lib");

const [brokerUrl, mapId, timeLapse, poses] = process.argv.slice(2);
const client = { interfaceName: "uagv", transport: { brokerUrl }, vdaVersion: "2.0.0" };

(async () => {
  for (const [k, [x, y, theta]] of JSON.parse(poses).entries()) {
    const agv = new AgvController(
      { manufacturer: "acme", serialNumber: `agv_${k}` }, client, { agvAdapterType: VirtualAgvAdapter },
      { timeLapse: Number(timeLapse), vehicleSpeed: 1, initialPosition: { mapId, x, y, theta, lastNodeId: `start_${k}` } });
    await agv.start();
  }
  console.log("ready");
})();
