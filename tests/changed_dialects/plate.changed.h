0 BEGIN PGM PLATE MM
; ph-post VERSION compensated this program
; ph-post: original sha256 e11b7f655f3ab76e34af88c9f53ebacc532e5b424ca077cb962c77e496bbd832
; ph-post: machine stepper router, sha256 4c3cf1243d64a44b
; ph-post: options sha256 0000000000000000
; ph-post: dialect heidenhain
; ph-post: offset X 0.03 mm
; ph-post: offset Y 0.04 mm
; ph-post: take-up X 0.12 mm
; ph-post: take-up Y 0.16 mm
; ph-post: 1 stops, 0 dips
; ph-post: 11 crossings, up to 1.1314 mm long, within 0.0024 mm
; ph-post: dwell 0 s, decimals 4, chord tolerance 0.001 mm, block time 5 ms
; ph-post: note holds for work offsets that are not rotated, mirrored or scaled
; ph-post: note holds where friction holds the axes against the cut
1 BLK FORM 0.1 Z X-40 Y-40 Z-20
2 BLK FORM 0.2 X+40 Y+40 Z+0
3 TOOL CALL 5 Z S3000 F500
4 L Z+100 R0 FMAX M3
; ph-post: +4 -1 restart here, X approach, Y approach
5 L X-20.09 Y+0.12 R0 FMAX
L X-19.97 F232.3
L Y-0.04 F240
L F500
6 L Z+2 R0 FMAX M8
7 L Z-2 F200
8 CC X+0 Y+0
; ph-post: +29 -5 crossing Y+, crossing X-, crossing Y-, crossing X+
9 CC X+0.03 Y-0.04
C X-0.5098 Y-20.0327 DR+ F1200
L X-0.2055 Y-20.0409 F1199
L X+0.03 Y-20.0211 F900.1
10 L X+0.125 Y-19.9808 F966.9 ; second quarter
L X+0.2655 Y-19.9609 F905.3
L X+0.5698 Y-19.9527 F1199
CC X+0.03 Y+0.04
C X+20.0227 Y-0.4998 DR+ F1200
L X+20.0309 Y-0.1982 F1199
L X+20.0161 Y+0.04 F1173
11 L X+19.9857 Y+0.1419 F1217
L X+19.9709 Y+0.2782 F1178
L X+19.9627 Y+0.5798 F1199
CC X-0.03 Y+0.04
C X+0.5098 Y+20.0327 DR+ F1200
L X+0.2055 Y+20.0409 F1199
L X-0.03 Y+20.0211 F900.1
12 L X-0.125 Y+19.9808 F966.9
L X-0.2655 Y+19.9609 F905.3
L X-0.5698 Y+19.9527 F1199
CC X-0.03 Y-0.04
C X-20.03 Y-0.04 DR+ F1200
13 L X-20.15 R0
L X-21.2814 Y+0.04 F1202
L X-30.03 F1200
L X-29.97 F232.3
CC X+0 Y+0
L F1200
14 L IX+5 IY+8
; ph-post: +2 -0 crossing Y-
L Y+7.96 F240
L F1200
15 CC X-30 Y+0
; ph-post: +14 -1 crossing X-, crossing X+, crossing Y+
16 CC X-29.97 Y-0.04
C X-20.5433 Y+0.3307 DR-
L X-20.5359 Y+0.1418 F1199
L X-20.5414 Y+0.0588 F806.4
L X-20.5557 Y-0.0241 F815.6
L X-20.576 Y-0.0969 F832.5
L X-20.5885 Y-0.1593 F819
L X-20.5959 Y-0.2218 F809.9
L X-20.6033 Y-0.4107 F1199
CC X-30.03 Y-0.04
C X-25.03 Y-8.04 DR- F1200
L X-24.97 Y-7.96 F300
CC X-30 Y+0
L F1200
17 L X-19.97 Y+0.04
; ph-post: +10 -1 crossing Y-, crossing X-
18 CR X-0.5098 Y+20.0327 R+20 DR-
L X-0.2055 Y+20.0409 F1199
L X-0.032 Y+20.021 F902.5
L X+0.125 Y+19.9808 F923.3
L X+0.2655 Y+19.9609 F905.3
L X+0.5698 Y+19.9527 F1199
CR X+20.03 Y-0.04 R+20 DR- F1200
L X+19.97 F232.3
L F1200
M9
19 L X+9.97 Y-5.04 M5
20 L Z+50 R0 FMAX
21 L X+0 Y+0 FMAX M30
; ph-post: undo 1/3 …
; ph-post: undo 2/3 …
; ph-post: undo 3/3 …
22 END PGM PLATE MM
