// With roslib.js: listens to joint states for some simulated time, and commands an arm and an order.
//
//     node roslib_client.mjs PORT ARM SECONDS
const { Ros, Topic, Service } = await import(`${process.env.ROSLIB}/dist/RosLib.js`);
const [port, arm, seconds] = process.argv.slice(2);
const ros = new Ros({ url: `ws://127.0.0.1:${port}` });
await new Promise((resolve, reject) => { ros.on("connection", resolve); ros.on("error", reject); });
const states = [];
const joints = new Topic({ ros, name: `/${arm}/joint_states`, messageType: "sensor_msgs/JointState" });
joints.subscribe((message) => states.push(message));
const stamp = (message) => message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec;
const nap = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
async function wait(found, mostMs = 150000) {
  const until = Date.now() + mostMs;
  while (Date.now() < until && !found()) await nap(20);
  return Boolean(found());
}
const call = (name, type, request) => new Promise((resolve, reject) =>
  new Service({ ros, name, serviceType: type }).callService(request, resolve, reject));
await wait(() => states.length);
await wait(() => stamp(states.at(-1)) - stamp(states[0]) > Number(seconds));
const seen = states.map(stamp);
const taken = await call(`/${arm}/take`, "std_srvs/Trigger", {});
const targets = new Topic({ ros, name: `/${arm}/joint_commands`, messageType: "sensor_msgs/JointState" });
const target = states.at(-1).position[6] - 0.5;
const aimed = await wait(() => {
  targets.publish({ name: ["joint_7"], position: [target] });
  return Math.abs(states.at(-1).position[6] - target) < 0.01;
});
const order = await call("/fleet/deliver", "fleet/Deliver", { pick: "pick_1", drop: "drop_1" });
const bad = await call("/fleet/deliver", "fleet/Deliver", { pick: "pick_9", drop: "drop_1" });
const released = await call(`/${arm}/release`, "std_srvs/Trigger", {});
const result = { taken: taken.success, aimed, order, bad, released: released.success, stamps_s: seen };
console.log("result", JSON.stringify(result));
process.exit(0);
