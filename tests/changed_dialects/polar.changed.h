0  BEGIN PGM POLAR MM
; ph-post VERSION compensated this program
; ph-post: original sha256 436e426aa638990f09f0b3966575cf848833e67cd55d2f90f37c3c806ecb8946
; ph-post: machine stepper router, sha256 4c3cf1243d64a44b
; ph-post: options sha256 0000000000000000
; ph-post: dialect heidenhain
; ph-post: offset X 0.03 mm
; ph-post: offset Y 0.04 mm
; ph-post: take-up X 0.12 mm
; ph-post: take-up Y 0.16 mm
; ph-post: 2 stops, 0 dips
; ph-post: 9 crossings, up to 0.1905 mm long, within 0.0003 mm
; ph-post: dwell 0 s, decimals 4, chord tolerance 0.001 mm, block time 5 ms
; ph-post: note holds for work offsets that are not rotated, mirrored or scaled
; ph-post: note holds where friction holds the axes against the cut
1  BLK FORM 0.1 Z  X+0  Y-200  Z-15
2  BLK FORM 0.2  X+500  Y+0  Z+0
3  * - contour, as posted by a CAM system: circles by angles, feeds by parameters
4  TOOL CALL 3 Z S1940
5  L M140 MB MAX
6  M3
; ph-post: +3 -1 restart here, X approach, Y approach
7  L  X+297.09  Y+1.12 R0 FMAX
L X+296.97 F232.3
L Y+0.96 F240
8  L  Z+15 R0 FMAX
9  CYCL DEF 32.0 TOLERANCE
10 CYCL DEF 32.1
11 FN 0: Q52 =+202 ; Finish
12 FN 0: Q58 =+67 ; Plunge
13 L  Z+5 FMAX
14 L  Z-3.5 FQ58
15 CC  X+295.97  Z-3.5
16 CP IPA+90 DR+ FQ52
17 L  X+294.97  Z-4.5
18 CC  X+294.97  Y-0.04
19 CP IPA+90 DR+
20 L  X+293.97  Y-23.29 FQ52
21 CC  X+288.97  Y-23.29
22 CP IPA-90 DR-
23 CC  X+288.97  Y-28.54
24 CP IPA+90 DR+ F56.5
25 CC  X+283.72  Y-28.54
26 CP IPA-90 DR- FQ52
; ph-post: +3 -1 crossing Y+
27 L X+283.6057 Y-33.54
L X+283.4153 Y-33.46 F217.3
L X+263.47 Y-33.46 FQ52
28 CC  X+263.5  Y-28.5
; ph-post: +11 -1 crossing X+, crossing Y-
29 CC X+263.47 Y-28.46
C X+258.4702 Y-28.5102 DR-
L X+258.4769 Y-28.4888 F210.4
L X+258.4903 Y-28.4674 F234.8
L X+258.5152 Y-28.4411 F270.7
L X+258.5302 Y-28.4098 F221.8
CC X+263.53 Y-28.46
C X+259.488 Y-25.5168 DR- FQ52
L Y-25.5968 F202
CC X+263.5 Y-28.5
L FQ52
30 L  X+263.03  Y-50.54
31 L  Y-52.54
; ph-post: +3 -1 crossing Y+
32 L X+263.06
L X+263.2504 Y-52.46 F217.3
L X+302.03 FQ52
33 CC  X+302  Y-40
; ph-post: +24 -1 crossing X-, crossing Y-, crossing X+, crossing Y+
34 CC X+302.03 Y-39.96
C X+314.5299 Y-40.0102 DR+
L X+314.5233 Y-39.989 F210.6
L X+314.5099 Y-39.9677 F235
L X+314.4849 Y-39.9413 F270.5
L X+314.4699 Y-39.9098 F221.5
CC X+301.97 Y-39.96
C X+302.0348 Y-27.4602 DR+ FQ52
L X+302.0087 Y-27.469 F212.1
L X+301.9827 Y-27.4868 F240.4
L X+301.9567 Y-27.5135 F281
L X+301.931 Y-27.5313 F240.8
L X+301.9052 Y-27.5402 F212.6
CC X+301.97 Y-40.04
C X+289.4701 Y-39.9898 DR+ FQ52
L X+289.4767 Y-40.011 F210.6
L X+289.4901 Y-40.0323 F235
L X+289.5151 Y-40.0587 F270.5
L X+289.5301 Y-40.0902 F221.5
CC X+302.03 Y-40.04
C X+302.03 Y-52.54 DR+ FQ52
L X+301.97 Y-52.46 F252.5
CC X+302 Y-40
L FQ52
35 L  Y+0.04 FQ52
36 CC  X+300.97  Y+0.04
37 CP IPA+90 DR+
38 L  X+299.97  Y+1.04
39 L  X+301  Z+15 FMAX
; ph-post: +2 -0 Y to 0
L Y+1 F120
L FQ52
40 M5
41 L M140 MB MAX
42 M30
; ph-post: undo 1/3 …
; ph-post: undo 2/3 …
; ph-post: undo 3/3 …
43 END PGM POLAR MM
