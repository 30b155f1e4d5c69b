// Headings by libraries of Node: clients.js LIBRARY PORT prints TIME KIND DEGREES of a hundred.
const [name, text] = process.argv.slice(2)
const port = Number(text)
const hostname = '127.0.0.1'
let left = 100

function print(line) {
  console.log(line)
  left -= 1
  if (left === 0) process.exit()
}

function watch(listener) {
  listener.on('ATT', (att) => {
    if ('heading' in att) print(`${att.time} true ${att.heading} magnetic ${att.mheading}`)
  })
  listener.connect(() => listener.watch())
}

if (name === 'node-gpsd') {
  const { Listener } = require('node-gpsd')
  watch(new Listener({ port, hostname }))
} else if (name === 'node-gpsd-client') {
  const Gpsd = require('node-gpsd-client')
  watch(new Gpsd({ port, hostname }))
} else if (name === 'signalk-schema') {
  // Deltas over UDP, held against Signal K's own schema.
  const { validateDelta } = require('@signalk/signalk-schema')
  const receiver = require('dgram').createSocket('udp4')
  receiver.on('message', (bytes) => {
    const delta = JSON.parse(bytes)
    const { valid, errors } = validateDelta(delta)
    if (!valid) throw new Error(errors.map((error) => `${error.dataPath}: ${error.message}`))
    const [{ timestamp, values }] = delta.updates
    const degrees = (path) => (values.find((one) => one.path === path).value * 180) / Math.PI
    const [magnetic, real] = ['navigation.headingMagnetic', 'navigation.headingTrue'].map(degrees)
    print(`${timestamp} magnetic ${magnetic} true ${real}`)
  })
  receiver.bind(port, hostname)
} else {
  // Signal K's provider hands what it receives to Signal K's parser, as its server does.
  const Provider = require('@signalk/streams/gpsd').default
  const Parser = require('@signalk/nmea0183-signalk')
  const parser = new Parser()
  const silent = () => {}
  const app = { setProviderStatus: silent, setProviderError: (id, message) => console.error(message) }
  const kinds = { 'navigation.headingMagnetic': 'magnetic', 'navigation.headingTrue': 'true' }
  new Provider({ port, hostname, app, providerId: 'headingd' }).on('data', (line) => {
    const delta = line.startsWith('$') ? parser.parse(line.trim()) : null
    for (const update of delta ? delta.updates : []) {
      for (const { path, value } of update.values) {
        if (kinds[path]) print(`- ${kinds[path]} ${(value * 180) / Math.PI}`)
      }
    }
  })
}
