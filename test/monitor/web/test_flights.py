# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""The page in a real browser, while node, player and monitor run as processes of their own."""

import contextlib
import signal
import subprocess
import time

from monitor.web.flight import ALARMS, HAZARDS, shows_what_is_published, STATE, TONE
from nav_msgs.msg import Odometry
import numpy as np
from PIL import Image
import pytest
from rig import wait_for

from plc_inspect.monitor.picture.condition import LANDED_TIME
from plc_inspect.ros.graph.qos import ODOMETRY

pytestmark = pytest.mark.slow

PAST = "document.querySelector('#past').textContent"
RECORDED = '-p', 'output.record:=true'
FLEET = """[...document.querySelectorAll('#fleet button')].map(item =>
[item.dataset.vehicle, item.textContent, item.getAttribute('aria-pressed')])"""


def test_it_shows_what_is_published_and_recovers(flight, browse, tmp_path):
    _, address = flight.start_page()
    assert address.startswith('http://127.0.0.1:')
    chrome = browse(address, 900, 500)
    chrome.wait(f"{STATE} == 'waiting for /plc_inspect: nothing heard yet'")
    node = flight.start_node('', *RECORDED)
    chrome.wait(f"{STATE} == 'waiting for the lidar: nobody publishes /velodyne_points; '"
                " + 'nobody publishes /odometry'")
    assert chrome.run(TONE) == 'critical'
    player = flight.play()
    wait_for(lambda: {'hazards', 'catenaries'} <= set(flight.newest), 'topics')
    wait_for(lambda: len(flight.rows('hazards')) and len(flight.rows('catenaries')) >= 6,
             'hazards', 60.0)
    chrome.wait(f"{ALARMS}.some(([state, text]) => state == 'new' && text.includes('hazard'))")
    assert 'ALARM' in chrome.page.title()

    chrome.page.keyboard.press('o')
    chrome.take_picture(tmp_path / 'page.png')
    pixels = np.asarray(Image.open(tmp_path / 'page.png').convert('RGB')).astype(int)
    pixels = pixels[200:, :480]
    assert ((pixels.max(axis=2) - pixels.min(axis=2)) > 60).sum() > 300  # something in colour

    player.kill()  # in mid-flight; another takes up, and later the node itself is killed
    player.wait()
    chrome.wait(f"{STATE}.startsWith('scans and poses stopped ')")
    wait_for(lambda: shows_what_is_published(chrome, flight), 'agreement at rest')
    chrome.wait("document.body.classList.contains('old')")
    node.kill()
    node.wait()
    chrome.wait(f"{STATE}.startsWith('LINK LOST')")
    assert chrome.run(HAZARDS)  # still there, and called old
    assert 'all of this is old' in chrome.run(STATE)
    assert chrome.run("document.querySelector('#hazards-age').textContent").endswith(': OLD')

    known = chrome.run(HAZARDS)
    chrome.page.keyboard.press('a')
    chrome.page.keyboard.type('crew')
    chrome.page.keyboard.press('Enter')
    chrome.wait(f"{ALARMS}.every(([state]) => state == 'acknowledged')")
    flight.start_node('', *RECORDED)  # it goes on from its record
    chrome.wait(f"{STATE}.startsWith('waiting for the lidar')")
    events = "document.querySelector('#events').textContent"
    chrome.wait(f"{events}.includes('started anew')")
    wait_for(lambda: chrome.run(HAZARDS) == known, 'hazards that were kept')
    assert {state for state, _ in chrome.run(ALARMS)} == {'acknowledged'}
    age = chrome.run("document.querySelector('#hazards-age').textContent")
    assert age.endswith('from before the restart of the node: OLD')
    flight.newest.clear()
    flight.play('--start', '30')
    chrome.wait(f"{events}.includes('the node went on with ')", 60.0)
    wait_for(lambda: {'hazards', 'catenaries'} <= set(flight.newest), 'results')
    wait_for(lambda: shows_what_is_published(chrome, flight), 'agreement again', 60.0)


def test_every_state_of_a_flight_is_told(flight, browse):
    _, address = flight.start_page('--record', flight.folder / 'flight.mcap')
    chrome = browse(address, 1024, 768)
    poses = []
    flight.node.create_subscription(Odometry, '/odometry', poses.append, ODOMETRY)
    node = flight.start_node()
    chrome.wait(f"{STATE}.startsWith('waiting for the lidar')")
    player = flight.play()
    chrome.wait(f"{STATE}.includes('sharpness of the map not known yet')")
    assert chrome.run(TONE) == 'notice'
    chrome.wait(f"{STATE}.startsWith('live: scans at ')")
    assert chrome.run(TONE) == 'ok'

    chrome.wait(f"{ALARMS}.some(([state, text]) => text.startsWith('keep-out'))")
    assert 'TOO NEAR' in chrome.run("document.querySelector('#instruments').textContent")
    chrome.page.keyboard.press('a')
    chrome.page.keyboard.type('crew')
    chrome.page.keyboard.press('Enter')
    chrome.wait(f"{ALARMS}.some(([state]) => state == 'acknowledged')")
    # near the line one thing follows the other, and rings anew
    over = f"['no longer near', 'another one is nearer'].some((why) => {PAST}.includes(why))"
    chrome.wait(f"{over} && {PAST}.includes('seen by crew')")
    chrome.page.keyboard.press('3')
    chrome.page.click('#past .pick')  # what was that alarm: the picture goes there
    assert chrome.run('station.scene.view') == 'free'

    node.send_signal(signal.SIGSTOP)  # as when the link is cut
    chrome.wait(f"{STATE}.startsWith('link late: nothing for ')")
    assert chrome.run(TONE) == 'warning'
    chrome.wait(f"{STATE}.startsWith('LINK LOST ')")
    assert chrome.run(TONE) == 'critical'
    standing = len(chrome.run(ALARMS))
    node.send_signal(signal.SIGCONT)
    chrome.wait(f"!{STATE}.toLowerCase().includes('link')")
    assert 'link is back after' in chrome.run("document.querySelector('#events').textContent")
    assert len(chrome.run(ALARMS)) >= standing  # nothing went by itself

    player.kill()
    player.wait()
    for topic, told in (('odometry', 'poses'), ('velodyne_points', 'scans')):
        # nobody listens to one of the topics: it is not waited for
        lame = flight.play('--start', '20', '--wait', '1', ros=('-r', f'{topic}:=nowhere'))
        chrome.wait(f"{STATE}.startsWith('{told} stopped ')")
        assert chrome.run(TONE) == 'critical'
        lame.kill()
        lame.wait()

    land(flight, poses[-1])
    chrome.wait(f"{STATE}.startsWith('landed')")
    assert chrome.run(TONE) == 'notice'


def test_a_map_that_is_not_sharp_is_told(flight, browse):
    _, address = flight.start_page()
    chrome = browse(address, 1024, 768)
    flight.start_node('', '-p', 'input.lidar_rpy_deg:=[0.0, 10.0, 0.0]')  # as nobody mounted it
    flight.play()
    chrome.wait(f"{STATE}.startsWith('map: map is not sharp')", 90.0)
    assert chrome.run(TONE) == 'critical'
    age = "document.querySelector('#hazards-age').textContent"
    chrome.wait(f"{age}.includes('HELD BACK')")
    # a node that gets little time may know by now how the mount is wrong, and say that instead
    chrome.wait("document.querySelector('#notes').textContent.includes('check mount')")
    assert not [text for _, text in chrome.run(ALARMS) if text.startswith('hazard')]


def land(flight, message):
    """Sink to the ground from the last pose, and stay there."""
    publisher = flight.node.create_publisher(Odometry, '/odometry', 10)
    height, began = message.pose.pose.position.z, time.monotonic()
    while (spent := time.monotonic() - began) < 8.0 + LANDED_TIME:
        message.header.stamp = flight.node.get_clock().now().to_msg()
        message.pose.pose.position.z = height - min(1.5 * spent, 10.5)
        publisher.publish(message)
        time.sleep(0.05)


def choose(chrome, name):
    """Click on a vehicle until the page, which is loaded anew, shows it, as a person would."""
    is_chosen = f"{FLEET}.some(([name,, pressed]) => name == '{name}' && pressed == 'true')"
    for _ in range(4):
        chrome.page.click(f'#fleet [data-vehicle="{name}"]')
        with contextlib.suppress(AssertionError):
            return chrome.wait(is_chosen, 30.0)
    said = chrome.run("location.href + ' ' + document.body.innerText")
    raise AssertionError(f'{name} was not chosen: {said[:2000]}')


def test_three_vehicles_on_one_page_are_not_mixed(flight, browse):
    _, address = flight.start_page()
    spaces = {'/one': (0, 4), '/two': (14, 4), '/three': (30, 8)}
    players = {}
    for space in spaces:
        flight.listen(space)
        flight.start_node(space)
    for space, (start, _) in spaces.items():
        players[space] = flight.play('--start', start, space=space)
    for space, (_, seconds) in spaces.items():
        wait_for(lambda space=space: space + 'catenaries' in flight.newest, 'results', 90.0)
        try:
            players[space].wait(seconds)
        except subprocess.TimeoutExpired:
            players[space].kill()
    chrome = browse(address, 1024, 768)
    chrome.wait(f'{FLEET}.length == 3')
    told = {}
    for space in spaces:
        name = f'{space}/plc_inspect'
        choose(chrome, name)
        wait_for(lambda space=space: shows_what_is_published(chrome, flight, space), space, 30.0)
        told[space] = flight.published(space)
        bar = chrome.run("document.querySelector('#alarm-sum').textContent").split(',')[0]
        (text,) = [text for own, text, _ in chrome.run(FLEET) if own == name]
        assert bar == '0 critical' or bar in text
    assert len({str(value) for value in told.values()}) == 3  # or nobody saw them mixed
